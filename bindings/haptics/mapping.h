// From the device's workspace to the world and back: pure functions, SI units.
#pragma once

#include <cmath>

#include "palpate_hdapi.h"

namespace palpate_hd {

struct Vec3 {
    double x, y, z;
};

inline Vec3 vec(const double *v) noexcept { return {v[0], v[1], v[2]}; }
inline void store(Vec3 v, double *to) noexcept { to[0] = v.x, to[1] = v.y, to[2] = v.z; }
inline Vec3 operator+(Vec3 a, Vec3 b) noexcept { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3 operator-(Vec3 a, Vec3 b) noexcept { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3 operator*(double s, Vec3 a) noexcept { return {s * a.x, s * a.y, s * a.z}; }
inline double dot(Vec3 a, Vec3 b) noexcept { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline double length(Vec3 a) noexcept { return std::sqrt(dot(a, a)); }
inline bool is_finite(Vec3 a) noexcept { return std::isfinite(a.x) && std::isfinite(a.y) && std::isfinite(a.z); }
inline Vec3 cross(Vec3 a, Vec3 b) noexcept {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/// The vector at most this long; its direction stays.
inline Vec3 at_most(Vec3 a, double most) noexcept {
    const double now = length(a);
    return now > most ? (most / now) * a : a;
}

/// A rotation, as palpate keeps it.
struct Quat {
    double x, y, z, w;
};

inline Quat quat(const double *q) noexcept { return {q[0], q[1], q[2], q[3]}; }
inline void store(Quat q, double *to) noexcept { to[0] = q.x, to[1] = q.y, to[2] = q.z, to[3] = q.w; }
inline Quat operator*(Quat a, Quat b) noexcept {
    return {a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
            a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z};
}
inline Vec3 rotate(Quat q, Vec3 v) noexcept {
    const Vec3 u{q.x, q.y, q.z};
    const Vec3 t = 2.0 * cross(u, v);
    return v + q.w * t + cross(u, t);
}
inline Quat inverse(Quat q) noexcept { return {-q.x, -q.y, -q.z, q.w}; }
inline double norm(Quat q) noexcept { return std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w); }

/// The rotation of a transform (columns first), of unit length; false where its columns are not near to axes.
inline bool rotation_of(const double *m, Quat *out) noexcept {
    const Vec3 x = vec(m), y = vec(m + 4), z = vec(m + 8);
    const double strain = std::fabs(dot(x, x) - 1.0) + std::fabs(dot(y, y) - 1.0) + std::fabs(dot(z, z) - 1.0) +
                          std::fabs(dot(x, y)) + std::fabs(dot(y, z)) + std::fabs(dot(z, x));
    if (!(strain < 0.05) || dot(cross(x, y), z) < 0.0) return false; // a NaN fails too
    // The largest of the four is found first, so that no division is by a small number.
    const double four[4] = {x.x - y.y - z.z, y.y - x.x - z.z, z.z - x.x - y.y, x.x + y.y + z.z};
    int big = 0;
    for (int i = 1; i < 4; ++i) {
        if (four[i] > four[big]) big = i;
    }
    const double r = std::sqrt(1.0 + four[big]), s = 0.5 / r;
    Quat q{};
    switch (big) {
    case 0: q = {0.5 * r, (y.x + x.y) * s, (z.x + x.z) * s, (y.z - z.y) * s}; break;
    case 1: q = {(y.x + x.y) * s, 0.5 * r, (z.y + y.z) * s, (z.x - x.z) * s}; break;
    case 2: q = {(z.x + x.z) * s, (z.y + y.z) * s, 0.5 * r, (x.y - y.x) * s}; break;
    default: q = {(y.z - z.y) * s, (z.x - x.z) * s, (x.y - y.x) * s, 0.5 * r}; break;
    }
    const double n = norm(q);
    *out = {q.x / n, q.y / n, q.z / n, q.w / n};
    return true;
}

/// The mapping with what each tick needs of it.
class Mapping {
public:
    Mapping() = default;
    explicit Mapping(const plp_hd_mapping &m) noexcept
        : turn_(quat(m.base.rotation)), origin_(vec(m.base.position_m)), scale_(m.scale),
          force_scale_(m.force_rule == PLP_HD_FORCE_BY_WORK ? m.scale : 1.0) {
        const double n = norm(turn_);
        turn_ = {turn_.x / n, turn_.y / n, turn_.z / n, turn_.w / n};
    }

    Vec3 place(Vec3 device_m) const noexcept { return origin_ + rotate(turn_, scale_ * device_m); }
    Vec3 velocity(Vec3 device_m_s) const noexcept { return rotate(turn_, scale_ * device_m_s); }
    Vec3 angular(Vec3 device_rad_s) const noexcept { return rotate(turn_, device_rad_s); }
    Quat rotation(Quat device) const noexcept { return turn_ * device; }
    Vec3 force(Vec3 world_n) const noexcept { return rotate(inverse(turn_), force_scale_ * world_n); }
    /// Angles are not scaled, so that the same torque does the same work under either rule.
    Vec3 torque(Vec3 world_n_m) const noexcept { return rotate(inverse(turn_), world_n_m); }
    double scale() const noexcept { return scale_; }
    double force_scale() const noexcept { return force_scale_; }

    /// Whether a mapping can be one.
    static bool is_good(const plp_hd_mapping &m) noexcept {
        const double n = norm(quat(m.base.rotation));
        return is_finite(vec(m.base.position_m)) && n > 0.9 && n < 1.1 && m.scale >= 1e-3 && m.scale <= 1e3 &&
               m.force_rule <= PLP_HD_FORCE_AS_FELT && m.reserved == 0;
    }

private:
    Quat turn_{0, 0, 0, 1};
    Vec3 origin_{0, 0, 0};
    double scale_ = 1.0, force_scale_ = 1.0;
};

/// Torques of a gimbal's three motors that together are a torque, by virtual work: each has the part along its axis.
/// The stylus turns by yaw about y, then pitch about the turned x, then roll about its own z; `stylus` is its rotation
/// in the device frame.
inline Vec3 gimbal_torque(Quat stylus, Vec3 angles_rad, Vec3 torque_n_m) noexcept {
    const double cr = std::cos(angles_rad.z), sr = std::sin(angles_rad.z);
    const double cp = std::cos(angles_rad.y), sp = std::sin(angles_rad.y);
    // In the stylus's own frame the axes hang on the angles behind them alone: wherever the arm is, this holds.
    const Vec3 pitch{cr, -sr, 0.0}, yaw{cp * sr, cp * cr, -sp}, roll{0.0, 0.0, 1.0};
    const Vec3 own = rotate(inverse(stylus), torque_n_m);
    return {dot(yaw, own), dot(pitch, own), dot(roll, own)};
}

} // namespace palpate_hd
