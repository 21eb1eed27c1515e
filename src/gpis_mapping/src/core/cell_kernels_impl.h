// SPDX-License-Identifier: BSD-3-Clause
// Compiled once per kind of processor, into the namespace GPIS_MAPPING_KERNELS: no include guard, and nothing of the
// standard library that could leave an inline function behind.
#include "cell_kernels.h"

#ifdef __SSE2__
#include <immintrin.h>
#endif

namespace gpis_mapping {
namespace GPIS_MAPPING_KERNELS {
namespace {

#ifdef __AVX2__
constexpr int kLanes = 8;
#else
constexpr int kLanes = 4;
#endif
static_assert(kCellPad % kLanes == 0, "arrays are padded to whole vectors");

#define GPIS_INLINE inline __attribute__((always_inline))

typedef float Vector __attribute__((vector_size(4 * kLanes)));
typedef int Integers __attribute__((vector_size(4 * kLanes)));
// For loads and stores at any address. A memcpy of 32 bytes goes by halves through the stack in GCC 12, and each load of it
// waits for two stores.
typedef float Anywhere __attribute__((vector_size(4 * kLanes), aligned(4), may_alias));

GPIS_INLINE Vector load(const float* p) {
  return *reinterpret_cast<const Anywhere*>(p);
}
GPIS_INLINE void store(float* p, Vector x) {
  *reinterpret_cast<Anywhere*>(p) = x;
}
GPIS_INLINE Vector splat(float x) {
  return Vector{} + x;
}
GPIS_INLINE Vector larger(Vector a, Vector b) {
  return a > b ? a : b;
}
GPIS_INLINE Vector smaller(Vector a, Vector b) {
  return a < b ? a : b;
}
/// Bit i: lane i of a comparison holds.
GPIS_INLINE unsigned bitsOf(Integers mask) {
#if defined(__AVX2__)
  return static_cast<unsigned>(_mm256_movemask_ps(reinterpret_cast<__m256>(mask)));
#elif defined(__SSE2__)
  return static_cast<unsigned>(_mm_movemask_ps(reinterpret_cast<__m128>(mask)));
#else
  unsigned bits = 0;
  for (int i = 0; i < kLanes; ++i) bits |= (mask[i] & 1u) << i;
  return bits;
#endif
}
GPIS_INLINE bool any(Integers mask) {
  return bitsOf(mask) != 0;
}
GPIS_INLINE float total(Vector x) {
  float sum = x[0];
  for (int i = 1; i < kLanes; ++i) sum += x[i];
  return sum;
}
GPIS_INLINE float largest(Vector x) {
  float most = x[0];
  for (int i = 1; i < kLanes; ++i) most = x[i] > most ? x[i] : most;
  return most;
}
GPIS_INLINE Vector squareRoot(Vector x) {
#if defined(__AVX2__)
  return reinterpret_cast<Vector>(_mm256_sqrt_ps(reinterpret_cast<__m256>(x)));
#elif defined(__SSE2__)
  return reinterpret_cast<Vector>(_mm_sqrt_ps(reinterpret_cast<__m128>(x)));
#else
  for (int i = 0; i < kLanes; ++i) x[i] = __builtin_sqrtf(x[i]);
  return x;
#endif
}

constexpr float kMoreThanRounding = 1.0001f;

/// exp(-x), x >= 0: 2^i 2^f with |f| <= 1/2, Taylor's series of 2^f to f^7. What it leaves out is below 1e-8.
GPIS_INLINE Vector expOfMinus(Vector x) {
  const Vector t = larger(x * -1.44269504f, splat(-126.0f));  // beyond: the least normal float
  const Integers i = __builtin_convertvector(t - 0.5f, Integers);
  const Vector f = t - __builtin_convertvector(i, Vector);
  Vector p = f * 1.52527338e-5f + 1.54035304e-4f;
  p = p * f + 1.33335581e-3f;
  p = p * f + 9.61812911e-3f;
  p = p * f + 5.55041087e-2f;
  p = p * f + 2.40226507e-1f;
  p = p * f + 6.93147181e-1f;
  p = p * f + 1.0f;
  return p * reinterpret_cast<Vector>((i + 127) << 23);
}

/// A ball about the places of a vector.
struct Ball {
  float x, y, z, radius;
};
GPIS_INLINE Ball ballAround(Vector qx, Vector qy, Vector qz) {
  const auto middle = [](Vector a) { return 0.5f * (largest(a) - largest(-a)); };
  Ball ball = {middle(qx), middle(qy), middle(qz), 0.0f};
  const Vector dx = qx - ball.x, dy = qy - ball.y, dz = qz - ball.z;
  ball.radius = kMoreThanRounding * __builtin_sqrtf(largest(dx * dx + dy * dy + dz * dz));
  return ball;
}

/// Of the points from `first` on, one per bit, those less than `reach` from the ball. What arrays are padded with may be
/// among them.
GPIS_INLINE unsigned pointsNear(const CellArrays& c, int first, const Ball& ball, float reach) {
  const Vector dx = load(c.x + first) - ball.x, dy = load(c.y + first) - ball.y, dz = load(c.z + first) - ball.z;
  const float sum = reach + ball.radius;
  return bitsOf(dx * dx + dy * dy + dz * dz < splat(sum * sum));
}

/// exp(-a d) and a d of points `i` against one place, or of one point against several places.
struct Correlation {
  Vector scaled, decay;
};
GPIS_INLINE Correlation correlation(float decay, Vector square) {
  const Vector scaled = decay * squareRoot(square);
  return {scaled, expOfMinus(scaled)};
}

/// Of the prior mean's quotient.
struct PriorSums {
  Vector weight{}, weighted{};
};
GPIS_INLINE void addPrior(const CellArrays& c, int i, Vector dx, Vector dy, Vector dz, Vector square, PriorSums* sums) {
  const Vector base = larger(1.0f - c.inverse_radius2 * square, Vector{});
  const Vector weight = c.quality[i] * base * base * base;
  sums->weight += weight;
  sums->weighted += weight * (c.nx[i] * dx + c.ny[i] * dy + c.nz[i] * dz);
}

constexpr float kLeastWeight = 1e-12f;  // of the prior mean's quotient

void means(const CellArrays& c, bool with_residual, const float* x, const float* y, const float* z, int count,
           float* values) {
  const int rows = with_residual ? c.num_training : 0;
  for (int q = 0; q < count; q += kLanes) {
    const Vector qx = load(x + q), qy = load(y + q), qz = load(z + q);
    PriorSums prior;
    Vector residual{};
    int i = 0;
    for (; i < rows; ++i) {
      const Vector dx = qx - c.x[i], dy = qy - c.y[i], dz = qz - c.z[i];
      const Vector square = dx * dx + dy * dy + dz * dz;
      addPrior(c, i, dx, dy, dz, square, &prior);
      const Correlation k = correlation(c.decay, square);
      residual += c.alpha[i] * (1.0f + k.scaled) * k.decay;
    }
    for (; i < c.num_points; ++i) {
      const Vector dx = qx - c.x[i], dy = qy - c.y[i], dz = qz - c.z[i];
      addPrior(c, i, dx, dy, dz, dx * dx + dy * dy + dz * dz, &prior);
    }
    const Vector value = prior.weighted / prior.weight + c.signal_variance_m2 * residual;
    store(values + q, prior.weight > kLeastWeight ? value : splat(__builtin_nanf("")));
  }
}

/// The residual's part of f, and of its gradient; a loop of its own, or the sums of both would not fit the registers.
struct Residual {
  Vector value{}, x{}, y{}, z{};
};
GPIS_INLINE Residual residualWithGradient(const CellArrays& c, Vector qx, Vector qy, Vector qz) {
  Residual sum;
  for (int i = 0; i < c.num_training; ++i) {
    const Vector dx = qx - c.x[i], dy = qy - c.y[i], dz = qz - c.z[i];
    const Correlation k = correlation(c.decay, dx * dx + dy * dy + dz * dz);
    const Vector share = c.alpha[i] * k.decay;
    sum.value += share * (1.0f + k.scaled);
    sum.x += share * dx;
    sum.y += share * dy;
    sum.z += share * dz;
  }
  const float scale = -c.signal_variance_m2 * c.decay * c.decay;
  return {c.signal_variance_m2 * sum.value, scale * sum.x, scale * sum.y, scale * sum.z};
}

void meansWithGradient(const CellArrays& cell, const float* x, const float* y, const float* z, int count, float* values,
                       float* gx, float* gy, float* gz) {
  const CellArrays c = cell;  // a copy: else what is stored might change it
  const float of_weights = -6.0f * c.inverse_radius2;
  const float blend_radius = kMoreThanRounding / __builtin_sqrtf(c.inverse_radius2);
  for (int q = 0; q < count; q += kLanes) {
    const Vector qx = load(x + q), qy = load(y + q), qz = load(z + q);
    // Quotient rule; dw/dx = -(6 / h^2) (1 - d^2/h^2)^2 (x - p), whose factor -6 / h^2 comes last.
    Vector weight{}, weighted{};
    Vector normal_x{}, normal_y{}, normal_z{}, along_x{}, along_y{}, along_z{}, slope_x{}, slope_y{}, slope_z{};
    const auto add = [&](int i) {
      const Vector dx = qx - c.x[i], dy = qy - c.y[i], dz = qz - c.z[i];
      const Vector base = larger(1.0f - c.inverse_radius2 * (dx * dx + dy * dy + dz * dz), Vector{});
      const Vector w2 = c.quality[i] * base * base;
      const Vector w = w2 * base;
      const Vector along = c.nx[i] * dx + c.ny[i] * dy + c.nz[i] * dz;
      weight += w;
      weighted += w * along;
      normal_x += w * c.nx[i];
      normal_y += w * c.ny[i];
      normal_z += w * c.nz[i];
      const Vector w2_along = w2 * along;
      along_x += w2_along * dx;
      along_y += w2_along * dy;
      along_z += w2_along * dz;
      slope_x += w2 * dx;
      slope_y += w2 * dy;
      slope_z += w2 * dz;
    };
    const Ball ball = ballAround(qx, qy, qz);
    for (int first = 0; first < c.num_points; first += kLanes) {
      unsigned bits = pointsNear(c, first, ball, blend_radius);
      for (; bits != 0; bits &= bits - 1) add(first + __builtin_ctz(bits));
    }
    const Vector inverse = 1.0f / weight;
    const Vector prior = weighted * inverse;
    const Integers is_valid = weight > kLeastWeight;
    const Vector nan = splat(__builtin_nanf(""));
    const Residual residual = residualWithGradient(c, qx, qy, qz);
    const auto gradient = [&](Vector normal, Vector along, Vector slope, Vector of_residual) {
      return (normal + of_weights * (along - prior * slope)) * inverse + of_residual;
    };
    store(values + q, is_valid ? prior + residual.value : nan);
    store(gx + q, is_valid ? gradient(normal_x, along_x, slope_x, residual.x) : nan);
    store(gy + q, is_valid ? gradient(normal_y, along_y, slope_y, residual.y) : nan);
    store(gz + q, is_valid ? gradient(normal_z, along_z, slope_z, residual.z) : nan);
  }
}

/// The nearest points found so far, nearest first; one list per lane.
struct NearestLists {
  Vector squares[kNearestPoints];
  Integers points[kNearestPoints];
};

constexpr int kCellShift = 24;  // a point's number: cell << 24 | index in the cell

GPIS_INLINE void insert(Vector square, int point, NearestLists* lists) {
  Integers is_before = square < lists->squares[kNearestPoints - 1];
  for (int r = kNearestPoints - 1; r > 0; --r) {
    const Integers is_before_next = square < lists->squares[r - 1];
    lists->points[r] = is_before ? (is_before_next ? lists->points[r - 1] : Integers{} + point) : lists->points[r];
    lists->squares[r] = smaller(lists->squares[r], larger(lists->squares[r - 1], square));
    is_before = is_before_next;
  }
  lists->points[0] = is_before ? Integers{} + point : lists->points[0];
  lists->squares[0] = smaller(lists->squares[0], square);
}

/// The nearest points of one vector of places, if all are within `limit2` [m^2].
GPIS_INLINE NearestLists findNearest(NearbyPoints* nearby_points, Vector qx, Vector qy, Vector qz, Vector limit2) {
  const NearbyPoints& nearby = *nearby_points;
  NearestLists lists;
  for (int r = 0; r < kNearestPoints; ++r) {
    lists.squares[r] = limit2;
    lists.points[r] = Integers{};
  }
  for (int n = 0; n < nearby.count; ++n) {
    const NearbyPoints::Cell& cell = nearby.cells[n];
    // A cell farther away than all lanes' lists reach would add nothing to any.
    Vector outside2{};
    const auto addGap = [&](Vector at, float side) {
      if (side == 0.0f) return;
      const Vector gap = larger(nearby.cell_reach - side * at, Vector{});
      outside2 += gap * gap;
    };
    addGap(qx, cell.side[0]);
    addGap(qy, cell.side[1]);
    addGap(qz, cell.side[2]);
    if (!any(outside2 < lists.squares[kNearestPoints - 1])) continue;
    if (cell.count == NearbyPoints::kUnread) nearby.read(nearby_points, n);
    const Vector rx = qx - cell.offset[0], ry = qy - cell.offset[1], rz = qz - cell.offset[2];
    for (int i = 0; i < cell.count; ++i) {
      const Vector dx = rx - cell.x[i], dy = ry - cell.y[i], dz = rz - cell.z[i];
      const Vector square = dx * dx + dy * dy + dz * dz;
      if (any(square < lists.squares[kNearestPoints - 1])) insert(square, n << kCellShift | i, &lists);
    }
  }
  return lists;
}

/// A point's normal, and where the place lies from it; one per lane.
struct Disc {
  float nx[kLanes], ny[kLanes], nz[kLanes], dx[kLanes], dy[kLanes], dz[kLanes];
};

// One pass: its parts would have to hand on most of the vectors, and the compiler keeps them in registers.
void readNearest(NearbyPoints* nearby_points, const float* x, const float* y, const float* z, int count,
                 NearestReadings* readings) {
  const NearbyPoints& nearby = *nearby_points;
  // The places before have found eight points: seen from here these are farther by the way between at most.
  Vector last_x{}, last_y{}, last_z{}, last_reach = splat(__builtin_inff());
  for (int q = 0; q < count; q += kLanes) {
    const Vector qx = load(x + q), qy = load(y + q), qz = load(z + q);
    const Vector step_x = qx - last_x, step_y = qy - last_y, step_z = qz - last_z;
    const Vector limit = last_reach + squareRoot(step_x * step_x + step_y * step_y + step_z * step_z);
    const NearestLists lists = findNearest(nearby_points, qx, qy, qz, kMoreThanRounding * limit * limit);
    last_x = qx;
    last_y = qy;
    last_z = qz;
    last_reach = squareRoot(lists.squares[kNearestPoints - 1]);
    const auto magnitude = [](Vector a) { return larger(a, -a); };
    const Vector reach = nearby.outer_reach - larger(magnitude(qx), larger(magnitude(qy), magnitude(qz)));
    const Integers is_complete = lists.squares[kNearestPoints - 1] < reach * reach;
    for (int lane = 0; lane < kLanes; ++lane) readings->is_complete[q + lane] = is_complete[lane];
    if (!any(is_complete)) continue;

    Disc discs[kNearestPoints] = {};
    for (int r = 0; r < kNearestPoints; ++r) {
      Disc& disc = discs[r];
      for (int lane = 0; lane < kLanes && q + lane < count; ++lane) {
        if (!is_complete[lane]) continue;
        const int number = lists.points[r][lane];
        const NearbyPoints::Cell& cell = nearby.cells[number >> kCellShift];
        const int i = number & ((1 << kCellShift) - 1);
        disc.nx[lane] = cell.nx[i];
        disc.ny[lane] = cell.ny[i];
        disc.nz[lane] = cell.nz[i];
        disc.dx[lane] = x[q + lane] - cell.offset[0] - cell.x[i];
        disc.dy[lane] = y[q + lane] - cell.offset[1] - cell.y[i];
        disc.dz[lane] = z[q + lane] - cell.offset[2] - cell.z[i];
      }
    }
    Vector along[kNearestPoints];
    Vector vote{};
    for (int r = 0; r < kNearestPoints; ++r) {
      const Disc& disc = discs[r];
      along[r] = load(disc.nx) * load(disc.dx) + load(disc.ny) * load(disc.dy) + load(disc.nz) * load(disc.dz);
      vote += expOfMinus((lists.squares[r] - lists.squares[0]) * nearby.inverse_vote_scale2) * along[r];
    }
    const Vector sign = vote < 0.0f ? splat(-1.0f) : splat(1.0f);
    Vector best = splat(__builtin_inff());
    Vector best_nx{}, best_ny{}, best_nz{}, away_x{}, away_y{}, away_z{};
    for (int r = 0; r < kNearestPoints; ++r) {
      const Disc& disc = discs[r];
      const Vector aside = squareRoot(larger(lists.squares[r] - along[r] * along[r], Vector{}));
      const Vector beyond = larger(aside - nearby.disc_radius_m, Vector{});
      Vector distance2 = along[r] * along[r] + beyond * beyond;
      if (r == 0) {
        store(readings->aside + q, aside);
      } else {
        distance2 = along[r] * sign < 0.0f ? splat(__builtin_inff()) : distance2;  // of the other side
      }
      const Integers is_best = distance2 < best;
      if (!any(is_best)) continue;
      best = is_best ? distance2 : best;
      const Vector nx = load(disc.nx), ny = load(disc.ny), nz = load(disc.nz);
      const Vector share = beyond > 0.0f ? beyond / aside : Vector{};
      const Vector of_normal = along[r] * (1.0f - share);
      best_nx = is_best ? nx : best_nx;
      best_ny = is_best ? ny : best_ny;
      best_nz = is_best ? nz : best_nz;
      away_x = is_best ? of_normal * nx + share * load(disc.dx) : away_x;
      away_y = is_best ? of_normal * ny + share * load(disc.dy) : away_y;
      away_z = is_best ? of_normal * nz + share * load(disc.dz) : away_z;
    }
    const Vector length = squareRoot(away_x * away_x + away_y * away_y + away_z * away_z);
    const Integers is_apart = length > 1e-9f;
    const Vector scale = sign / length;
    store(readings->gx + q, is_apart ? away_x * scale : best_nx);
    store(readings->gy + q, is_apart ? away_y * scale : best_ny);
    store(readings->gz + q, is_apart ? away_z * scale : best_nz);
    store(readings->distance + q, sign * squareRoot(best));
    store(readings->nearest + q, squareRoot(lists.squares[0]));
    for (int lane = 0; lane < kLanes; ++lane) {
      readings->cell[q + lane] = lists.points[0][lane] >> kCellShift;
      readings->point[q + lane] = lists.points[0][lane] & ((1 << kCellShift) - 1);
    }
  }
}

/// Left-looking, column by column from the diagonal's vector on; the rows finished so far are kept beside the columns, so
/// that no access is strided.
bool factorise(const CellArrays& c, const float* noise, float jitter, float* scratch, float* factor) {
  const int n = c.num_training;
  const int stride = padded(n);
  float* const columns = scratch;
  float* const rows = scratch + stride * stride;
  for (int j = 0; j < n; ++j) {
    float* const column = columns + j * stride;
    const int first = j / kLanes * kLanes;
    const float* const pivot = rows + j * stride;
    for (int r = first; r < stride; r += 2 * kLanes) {
      const bool is_pair = r + kLanes < stride;
      const int next = is_pair ? r + kLanes : r;
      const auto covariance = [&](int at) {
        const Vector dx = load(c.x + at) - c.x[j], dy = load(c.y + at) - c.y[j], dz = load(c.z + at) - c.z[j];
        const Correlation k = correlation(c.decay, dx * dx + dy * dy + dz * dz);
        return c.signal_variance_m2 * (1.0f + k.scaled) * k.decay;
      };
      store(column + r, covariance(r));
      if (is_pair) store(column + next, covariance(next));
      if (r == first) column[j] = c.signal_variance_m2 + noise[j] + jitter;
      Vector a = load(column + r), b = load(column + next);
      for (int k = 0; k < j; ++k) {
        a -= load(columns + k * stride + r) * pivot[k];
        b -= load(columns + k * stride + next) * pivot[k];
      }
      store(column + next, b);
      store(column + r, a);
    }
    if (!(column[j] > 0.0f)) return false;
    const float scale = 1.0f / __builtin_sqrtf(column[j]);
    for (int r = first; r < stride; r += kLanes) store(column + r, load(column + r) * scale);
    for (int i = j; i < n; ++i) rows[i * stride + j] = column[i];
  }
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j <= i; ++j) factor[packedSize(i) + j] = rows[i * stride + j];
  }
  return true;
}

void solve(const float* factor, int n, float* x) {
  for (int j = 0; j < n; ++j) {
    const float* const row = factor + packedSize(j);
    Vector sums{};
    int i = 0;
    for (; i + kLanes <= j; i += kLanes) sums += load(row + i) * load(x + i);
    float left = x[j] - total(sums);
    for (; i < j; ++i) left -= row[i] * x[i];
    x[j] = left / row[j];
  }
  for (int j = n - 1; j >= 0; --j) {
    const float* const row = factor + packedSize(j);
    x[j] /= row[j];
    int i = 0;
    for (; i + kLanes <= j; i += kLanes) store(x + i, load(x + i) - load(row + i) * x[j]);
    for (; i < j; ++i) x[i] -= row[i] * x[j];
  }
}

void variances(const CellArrays& c, const float* x, const float* y, const float* z, int count, float* scratch,
               float* variance, float* gx, float* gy, float* gz) {
  const int n = c.num_training;
  float* const solved = scratch;
  float* const decays = scratch + kLanes * padded(n);
  for (int q = 0; q < count; q += kLanes) {
    const Vector qx = load(x + q), qy = load(y + q), qz = load(z + q);
    Vector squares{};
    for (int j = 0; j < n; ++j) {
      const Vector dx = qx - c.x[j], dy = qy - c.y[j], dz = qz - c.z[j];
      const Correlation k = correlation(c.decay, dx * dx + dy * dy + dz * dz);
      store(decays + kLanes * j, k.decay);
      const float* const row = c.factor + packedSize(j);
      Vector rest[4] = {c.signal_variance_m2 * (1.0f + k.scaled) * k.decay};  // four sums: one would wait for itself
      int i = 0;
      for (; i + 4 <= j; i += 4) {
        for (int s = 0; s < 4; ++s) rest[s] -= row[i + s] * load(solved + kLanes * (i + s));
      }
      for (; i < j; ++i) rest[0] -= row[i] * load(solved + kLanes * i);
      const Vector v = (rest[0] + rest[1] + (rest[2] + rest[3])) / row[j];
      store(solved + kLanes * j, v);
      squares += v * v;
    }
    store(variance + q, larger(c.signal_variance_m2 - squares, Vector{}));
    if (gx == nullptr) continue;
    Vector sum_x{}, sum_y{}, sum_z{};
    for (int j = n - 1; j >= 0; --j) {  // now (K + K_x)^-1 k*
      const float* const row = c.factor + packedSize(j);
      const Vector w = load(solved + kLanes * j) / row[j];
      for (int i = 0; i < j; ++i) store(solved + kLanes * i, load(solved + kLanes * i) - row[i] * w);
      const Vector share = w * load(decays + kLanes * j);
      sum_x += share * (qx - c.x[j]);
      sum_y += share * (qy - c.y[j]);
      sum_z += share * (qz - c.z[j]);
    }
    const float scale = 2.0f * c.signal_variance_m2 * c.decay * c.decay;
    store(gx + q, scale * sum_x);
    store(gy + q, scale * sum_y);
    store(gz + q, scale * sum_z);
  }
}

constexpr CellKernels kKernels = {means, meansWithGradient, readNearest, factorise, solve, variances};

}  // namespace

const CellKernels& kernels();
const CellKernels& kernels() {
  return kKernels;
}

}  // namespace GPIS_MAPPING_KERNELS
}  // namespace gpis_mapping
