// The laws of the lattice, in single precision: twins of src/model/law.rs. Plain C++ as well as CUDA, so that a test compares them with
// the Rust functions where there is no GPU.
#pragma once

#ifdef __CUDACC__
#define PLP_LAW __device__ __forceinline__
#else
#include <cmath>
#define PLP_LAW inline
inline float rsqrtf(float x) { return 1.0f / std::sqrt(x); }
#endif

// 1 - L / |l| from |l|^2 = `length2`, for the rest length `rest`. In single precision the strain is right to about 1e-7. Finite at any length: where there is no spring, between a node and an
// empty place, ends do meet.
PLP_LAW float elongation(float length2, float rest) { return 1.0f - rest * rsqrtf(fmaxf(length2, 1e-6f * (rest * rest))); }

// Damping in N s / m of each node of a piece of `share` of a cell against the mean of all eight, by the cell's spring constant and the mass of its corner.
PLP_LAW float sliver_damping(float spring, float corner, float share) {
    constexpr float SLIVER = 0.1f, RATE = 0.2f;
    const float thin = fmaxf(1.0f - share * (1.0f / SLIVER), 0.0f);
    return RATE * sqrtf(spring * corner) * share * (thin * thin);
}

// a d - b c.
PLP_LAW float minor(float a, float d, float b, float c) { return a * d - b * c; }

// Cofactor matrix and J - 1 of F = I + G, from the displacement gradient `g[3 * row + column]`, without the cancellation of det F - 1.
PLP_LAW float volume_change(const float g[9], float cof[9]) {
    const float f0 = g[0] + 1.0f, f4 = g[4] + 1.0f, f8 = g[8] + 1.0f;
    cof[0] = minor(f4, f8, g[5], g[7]);
    cof[1] = minor(g[5], g[6], g[3], f8);
    cof[2] = minor(g[3], g[7], f4, g[6]);
    cof[3] = minor(g[2], g[7], g[1], f8);
    cof[4] = minor(f0, f8, g[2], g[6]);
    cof[5] = minor(g[1], g[6], f0, g[7]);
    cof[6] = minor(g[1], g[5], g[2], f4);
    cof[7] = minor(g[2], g[3], f0, g[5]);
    cof[8] = minor(f0, f4, g[1], g[3]);

    // J - 1 = tr G + (second-order minors of G) + det G, summed from the smallest terms.
    const float c0 = minor(g[4], g[8], g[5], g[7]);
    const float c1 = minor(g[5], g[6], g[3], g[8]);
    const float c2 = minor(g[3], g[7], g[4], g[6]);
    const float det = g[0] * c0 + (g[1] * c1 + g[2] * c2);
    const float second = c0 + minor(g[0], g[8], g[2], g[6]) + minor(g[0], g[4], g[1], g[3]);
    return (g[0] + g[4] + g[8]) + (second + det);
}
