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
GPIS_INLINE float total(Vector x) {
  float sum = x[0];
  for (int i = 1; i < kLanes; ++i) sum += x[i];
  return sum;
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

bool meanWithGradient(const CellArrays& c, float x, float y, float z, float* result) {
  // Quotient rule; dw/dx = -(6 / h^2) (1 - d^2/h^2)^2 (x - p), whose factor -6 / h^2 comes last.
  Vector weight{}, weighted{}, residual{};
  Vector normal_x{}, normal_y{}, normal_z{}, along_x{}, along_y{}, along_z{}, slope_x{}, slope_y{}, slope_z{};
  Vector residual_x{}, residual_y{}, residual_z{};
  for (int i = 0; i < c.num_points; i += kLanes) {
    const Vector dx = x - load(c.x + i), dy = y - load(c.y + i), dz = z - load(c.z + i);
    const Vector square = dx * dx + dy * dy + dz * dz;
    const Vector base = larger(1.0f - c.inverse_radius2 * square, Vector{});
    const Vector w2 = load(c.quality + i) * base * base;
    const Vector w = w2 * base;
    const Vector nx = load(c.nx + i), ny = load(c.ny + i), nz = load(c.nz + i);
    const Vector along = nx * dx + ny * dy + nz * dz;
    weight += w;
    weighted += w * along;
    normal_x += w * nx;
    normal_y += w * ny;
    normal_z += w * nz;
    const Vector w2_along = w2 * along;
    along_x += w2_along * dx;
    along_y += w2_along * dy;
    along_z += w2_along * dz;
    slope_x += w2 * dx;
    slope_y += w2 * dy;
    slope_z += w2 * dz;
    if (i >= c.num_training) continue;
    const Correlation k = correlation(c.decay, square);
    const Vector share = load(c.alpha + i) * k.decay;
    residual += share * (1.0f + k.scaled);
    residual_x += share * dx;
    residual_y += share * dy;
    residual_z += share * dz;
  }
  const float sum = total(weight);
  if (!(sum > kLeastWeight)) return false;
  const float prior = total(weighted) / sum;
  const float of_weights = -6.0f * c.inverse_radius2;
  const float of_residual = c.signal_variance_m2 * c.decay * c.decay;
  result[0] = prior + c.signal_variance_m2 * total(residual);
  result[1] = (total(normal_x) + of_weights * (total(along_x) - prior * total(slope_x))) / sum -
              of_residual * total(residual_x);
  result[2] = (total(normal_y) + of_weights * (total(along_y) - prior * total(slope_y))) / sum -
              of_residual * total(residual_y);
  result[3] = (total(normal_z) + of_weights * (total(along_z) - prior * total(slope_z))) / sum -
              of_residual * total(residual_z);
  return true;
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
      Vector a = c.signal_variance_m2 * (1.0f + k.scaled) * k.decay, b{};
      int i = 0;
      for (; i + 2 <= j; i += 2) {
        a -= row[i] * load(solved + kLanes * i);
        b -= row[i + 1] * load(solved + kLanes * (i + 1));
      }
      if (i < j) a -= row[i] * load(solved + kLanes * i);
      const Vector v = (a + b) / row[j];
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

constexpr CellKernels kKernels = {means, meanWithGradient, factorise, solve, variances};

}  // namespace

const CellKernels& kernels();
const CellKernels& kernels() {
  return kKernels;
}

}  // namespace GPIS_MAPPING_KERNELS
}  // namespace gpis_mapping
