// The laws of a meshless cell, in single and double precision: twins of src/model/efg/law.rs and src/cpu/efg/laws.rs, which say what they mean. Plain C++ as
// well as CUDA.
#pragma once
#include "law.cuh"
#include <math.h>

// A 3 × 3 matrix, m[row][column].
template <class R>
struct Matrix {
    R m[3][3];
};

// A rotation as a unit quaternion.
template <class R>
struct Rotation {
    R x, y, z, w;
};

// A symmetric matrix.
template <class R>
struct Block {
    R xx, xy, xz, yy, yz, zz;
};

// What a cell gives to its corner i at signs s, which has moved by u: mean + q s − hourglass u.
template <class R>
struct Answer {
    Matrix<R> q;
    R mean[3];
};

// The mean displacement gradient of a cell, and the sums of its corners' components.
template <class R>
struct Gradient {
    Matrix<R> g;
    R sums[3];
};

// What a cell of one material, and of an edge h, resists by: moduli in Pa and N/m, or these times what a step makes of them.
template <class R>
struct Moduli {
    R mu, lambda, hourglass;
};

PLP_LAW float larger(float a, float b) { return fmaxf(a, b); }
PLP_LAW double larger(double a, double b) { return fmax(a, b); }
PLP_LAW float root(float x) { return sqrtf(x); }
PLP_LAW double root(double x) { return sqrt(x); }

// a b.
template <class R>
PLP_LAW Matrix<R> product(const Matrix<R>& a, const Matrix<R>& b) {
    Matrix<R> c;
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) c.m[i][j] = a.m[i][0] * b.m[0][j] + (a.m[i][1] * b.m[1][j] + a.m[i][2] * b.m[2][j]);
    }
    return c;
}

// aᵀ b.
template <class R>
PLP_LAW Matrix<R> transposed_product(const Matrix<R>& a, const Matrix<R>& b) {
    Matrix<R> c;
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) c.m[i][j] = a.m[0][i] * b.m[0][j] + (a.m[1][i] * b.m[1][j] + a.m[2][i] * b.m[2][j]);
    }
    return c;
}

// μ (E + Eᵀ) + λ tr E.
template <class R>
PLP_LAW Matrix<R> hooke(const Matrix<R>& e, R mu, R lambda) {
    const R pressure = lambda * (e.m[0][0] + e.m[1][1] + e.m[2][2]), two_mu = mu + mu;
    const R xy = mu * (e.m[0][1] + e.m[1][0]), xz = mu * (e.m[0][2] + e.m[2][0]), yz = mu * (e.m[1][2] + e.m[2][1]);
    return {{{two_mu * e.m[0][0] + pressure, xy, xz}, {xy, two_mu * e.m[1][1] + pressure, yz}, {xz, yz, two_mu * e.m[2][2] + pressure}}};
}

// How stress changes with the displacement gradient by `dg`, in the frame `a` of a cell.
template <class R>
PLP_LAW Matrix<R> stress_change(const Matrix<R>& a, const Matrix<R>& dg, R mu, R lambda) {
    return product(a, hooke(transposed_product(a, dg), mu, lambda));
}

// I + G.
template <class R>
PLP_LAW Matrix<R> deformation(Matrix<R> g) {
    for (int i = 0; i < 3; ++i) g.m[i][i] += R(1);
    return g;
}

// Rᵀ F − I, for the rotation in F = I + G.
template <class R>
PLP_LAW Matrix<R> corotated_strain(const Matrix<R>& r, const Matrix<R>& g) {
    Matrix<R> s = transposed_product(r, g);
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) s.m[i][j] += r.m[j][i] - R(i == j);
    }
    return s;
}

// Stress of a corotated cell.
template <class R>
PLP_LAW Matrix<R> corotated_stress(const Matrix<R>& r, const Matrix<R>& g, R mu, R lambda) {
    return product(r, hooke(corotated_strain(r, g), mu, lambda));
}

// ½ (G + Gᵀ + Gᵀ G).
template <class R>
PLP_LAW Matrix<R> green_strain(const Matrix<R>& g) {
    Matrix<R> s = transposed_product(g, g);
    for (int i = 0; i < 3; ++i) {
        for (int j = i; j < 3; ++j) s.m[i][j] = s.m[j][i] = R(0.5) * (g.m[i][j] + g.m[j][i] + s.m[i][j]);
    }
    return s;
}

template <class R>
PLP_LAW Matrix<R> rotation_matrix(const Rotation<R>& q) {
    const R x2 = q.x + q.x, y2 = q.y + q.y, z2 = q.z + q.z, xx = q.x * x2, yy = q.y * y2, zz = q.z * z2;
    return {{{R(1) - yy - zz, q.x * y2 - q.w * z2, q.x * z2 + q.w * y2},
             {q.x * y2 + q.w * z2, R(1) - xx - zz, q.y * z2 - q.w * x2},
             {q.x * z2 - q.w * y2, q.y * z2 + q.w * x2, R(1) - xx - yy}}};
}

// One step of Newton's method from a rotation towards that in F.
template <class R>
PLP_LAW Rotation<R> turn_towards(const Rotation<R>& q, const Matrix<R>& f) {
    const Matrix<R> s = transposed_product(rotation_matrix(q), f);
    const R ax = s.m[2][1] - s.m[1][2], ay = s.m[0][2] - s.m[2][0], az = s.m[1][0] - s.m[0][1];
    const R xy = R(0.5) * (s.m[0][1] + s.m[1][0]), xz = R(0.5) * (s.m[0][2] + s.m[2][0]), yz = R(0.5) * (s.m[1][2] + s.m[2][1]);
    // L D Lᵀ of tr S − S, with pivots kept well above nothing.
    const R trace = s.m[0][0] + s.m[1][1] + s.m[2][2], least = larger(trace * R(0.1), R(0.1));
    const R r0 = R(1) / larger(trace - s.m[0][0], least), l10 = -xy * r0, l20 = -xz * r0;
    const R r1 = R(1) / larger(trace - s.m[1][1] + l10 * xy, least), below = l10 * xz - yz, l21 = below * r1;
    const R d2 = larger(trace - s.m[2][2] + l20 * xz - l21 * below, least);
    const R y1 = ay - l10 * ax, y2 = az - l20 * ax - l21 * y1;
    // Half of the turn that is left.
    R z = y2 / d2, y = y1 * r1 - l21 * z, x = ax * r0 - l10 * y - l20 * z;
    x *= R(0.5), y *= R(0.5), z *= R(0.5);
    const Rotation<R> turned{q.x + q.w * x + q.y * z - q.z * y, q.y + q.w * y + q.z * x - q.x * z, q.z + q.w * z + q.x * y - q.y * x,
                             q.w - q.x * x - q.y * y - q.z * z};
    const R shorten = R(1) / root(turned.x * turned.x + (turned.y * turned.y + (turned.z * turned.z + turned.w * turned.w)));
    return {turned.x * shorten, turned.y * shorten, turned.z * shorten, turned.w * shorten};
}

// Of corners that have moved by u[component][corner], bit a of a corner standing for its upper end along axis a.
template <class R>
PLP_LAW Gradient<R> gradient(const R u[3][8], R inverse_4h) {
    Gradient<R> all;
    for (int c = 0; c < 3; ++c) {
        const R* v = u[c];
        const R sa = v[0] + v[1], sb = v[2] + v[3], sd = v[4] + v[5], se = v[6] + v[7];
        all.g.m[c][0] = ((v[1] - v[0]) + (v[3] - v[2]) + ((v[5] - v[4]) + (v[7] - v[6]))) * inverse_4h;
        all.g.m[c][1] = ((sb - sa) + (se - sd)) * inverse_4h;
        all.g.m[c][2] = ((sd - sa) + (se - sb)) * inverse_4h;
        all.sums[c] = sa + sb + (sd + se);
    }
    return all;
}

// What stress, and what affine motion leaves of its corners', make a cell of edge h give.
template <class R>
PLP_LAW Answer<R> cell_answer(const Gradient<R>& seen, const Matrix<R>& stress, R hourglass, R h) {
    const R pull = hourglass * (R(0.5) * h), area = R(0.25) * h * h;
    Answer<R> all;
    for (int c = 0; c < 3; ++c) {
        for (int k = 0; k < 3; ++k) all.q.m[c][k] = seen.g.m[c][k] * pull - stress.m[c][k] * area;
        all.mean[c] = seen.sums[c] * (hourglass * R(0.125));
    }
    return all;
}

// What a corner at signs s = (±1, ±1, ±1) resists to its own motion, in a cell of frame `a`.
template <class R>
PLP_LAW Block<R> corner_block(const Matrix<R>& a, const Moduli<R>& by, R h, R sx, R sy, R sz) {
    // h³ (μ |b|² A Aᵀ + (λ + μ) t tᵀ) with b = s / (4 h) and t = A b; of its own motion the cell sees half.
    const R share = h * R(0.0625), straight = R(3) * by.mu * share, along = (by.lambda + by.mu) * share, unseen = by.hourglass * R(0.5);
    R t[3];
    for (int i = 0; i < 3; ++i) t[i] = a.m[i][0] * sx + (a.m[i][1] * sy + a.m[i][2] * sz);
    const auto entry = [&](int i, int j) {
        const R gram = a.m[i][0] * a.m[j][0] + (a.m[i][1] * a.m[j][1] + a.m[i][2] * a.m[j][2]);
        return straight * gram + along * t[i] * t[j] + (i == j ? unseen : R(0));
    };
    return {entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)};
}

// The inverse of a symmetric matrix.
template <class R>
PLP_LAW Block<R> inverted(const Block<R>& b) {
    const R xx = b.yy * b.zz - b.yz * b.yz, xy = b.xz * b.yz - b.xy * b.zz, xz = b.xy * b.yz - b.xz * b.yy;
    const R scale = R(1) / (b.xx * xx + (b.xy * xy + b.xz * xz));
    return {xx * scale, xy * scale, xz * scale, (b.xx * b.zz - b.xz * b.xz) * scale, (b.xy * b.xz - b.xx * b.yz) * scale,
            (b.xx * b.yy - b.xy * b.xy) * scale};
}
