// SPDX-License-Identifier: BSD-3-Clause
#ifndef GPIS_MAPPING_CELL_KERNELS_H
#define GPIS_MAPPING_CELL_KERNELS_H

namespace gpis_mapping {

/// The arithmetic of a cell's GP over plain arrays. It is compiled once for any processor and, on x86-64, once more for
/// those with AVX2 and FMA; no type of Eigen or of the standard library crosses this border, and the functions below are
/// static, or the linker might keep the instance of an inline function that not every processor can run.

/// Arrays are padded to this many floats: a multiple of the lanes of every processor served.
constexpr int kCellPad = 8;

static constexpr int padded(int n) {
  return (n + kCellPad - 1) / kCellPad * kCellPad;
}

/// Entries of a lower triangle of `n` rows, packed row by row.
static constexpr int packedSize(int n) {
  return n * (n + 1) / 2;
}

/// A cell's points relative to its centre [m]. Each array has padded(num_points) floats; quality and alpha are 0 beyond
/// the points and the training points.
struct CellArrays {
  int num_points;
  int num_training;  // the first so many are rows of the GP
  const float *x, *y, *z;
  const float *nx, *ny, *nz;
  const float* quality;      // say in the prior mean
  const float* alpha;        // (K + K_x)^-1 (0 - m(X))
  const float* factor;       // packed lower Cholesky factor of K + K_x
  float inverse_radius2;     // of the blend radius [1/m^2]
  float decay;               // sqrt(3) / length scale [1/m]
  float signal_variance_m2;  // k(x, x)
};

/// The points that the cells about a place have of their own.
struct NearbyPoints {
  static constexpr int kUnread = -1;
  struct Cell {
    int count;               // of its points; kUnread: not filled in yet, nor is what follows up to nz
    const float *x, *y, *z;  // relative to the cell's centre [m]
    const float *nx, *ny, *nz;
    float offset[3];  // of its centre from the middle cell's [m]
    float side[3];    // on which side of the middle cell it lies: -1, 0 or 1
  };
  Cell cells[27];  // in the order of the search
  int count;
  void (*read)(NearbyPoints* nearby, int cell);  // fills a cell in when the search comes to it
  float cell_reach;                              // half a cell less what points may have strayed out of theirs [m]
  float outer_reach;                             // the same to the border of all 27 [m]
  float disc_radius_m;
  float inverse_vote_scale2;  // [1/m^2]
};

constexpr int kNearestPoints = 8;

constexpr int kMaxPlaces = 128;  // that are read together

/// What the nearest of them, as discs, say of places.
struct NearestReadings {
  int is_complete[kMaxPlaces];  // 0: points outside of the 27 cells may be nearer than some; the rest is undefined
  float distance[kMaxPlaces];   // to the nearest disc, with the sign of the side that the near discs vote for [m]
  float gx[kMaxPlaces], gy[kMaxPlaces], gz[kMaxPlaces];
  float nearest[kMaxPlaces];                // to the nearest point [m]
  float aside[kMaxPlaces];                  // of the nearest point's normal line [m]
  int cell[kMaxPlaces], point[kMaxPlaces];  // the nearest: index in NearbyPoints::cells, and in that cell
};

struct CellKernels {
  /// f at `count` points, NaN where there is none; arrays of padded(count) floats. Without `with_residual` the prior mean.
  void (*means)(const CellArrays& cell, bool with_residual, const float* x, const float* y, const float* z, int count,
                float* values);
  /// The same with the gradient of f.
  void (*meansWithGradient)(const CellArrays& cell, const float* x, const float* y, const float* z, int count,
                            float* values, float* gx, float* gy, float* gz);
  /// The nearest points of `count` <= kMaxPlaces places [m from the middle cell's centre], of those equally far the first in
  /// the order of the search. Fastest if places that follow one another are near one another.
  void (*readNearest)(NearbyPoints* nearby, const float* x, const float* y, const float* z, int count,
                      NearestReadings* readings);
  /// Cholesky factor of the training points' covariance with `noise` added to its diagonal; false if that is not positive
  /// definite. `scratch`: factorScratch(num_training) floats.
  bool (*factorise)(const CellArrays& cell, const float* noise, float jitter, float* scratch, float* factor);
  /// x = (L L^T)^-1 x.
  void (*solve)(const float* factor, int n, float* x);
  /// Variance at `count` points, as above; gx, gy, gz: its gradient, or null. `scratch`: varianceScratch(num_training).
  void (*variances)(const CellArrays& cell, const float* x, const float* y, const float* z, int count, float* scratch,
                    float* variance, float* gx, float* gy, float* gz);
};

static constexpr int factorScratch(int n) {
  return 2 * padded(n) * padded(n);
}
static constexpr int varianceScratch(int n) {
  return 2 * kCellPad * padded(n);
}

const CellKernels& portableCellKernels();
/// Null where this processor has no AVX2 and FMA.
const CellKernels* avx2CellKernels();
/// The fastest of these.
const CellKernels& cellKernels();

}  // namespace gpis_mapping

#endif  // GPIS_MAPPING_CELL_KERNELS_H
