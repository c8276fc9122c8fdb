// hdGet and hdSet: HDAPI's units outside (mm, mN m, columns first), SI inside.
#include <cmath>

#include "state.h"

using namespace emulator;

namespace {

constexpr double MM = 1e3, MNM = 1e3;
enum Kind { UNKNOWN, WHOLE, REAL, EITHER };

/// A value of HDAPI: at most 16 numbers, and which types ask for it.
struct Value {
    Kind kind = UNKNOWN;
    int count = 0;
    double numbers[16] = {};

    Value() = default;
    Value(Kind k, double x) : kind(k), count(1) { numbers[0] = x; }
    Value(const Vec3 &v, double scale) : kind(REAL), count(3) {
        for (int i = 0; i < 3; ++i) numbers[i] = scale * v[i];
    }
};

/// The stylus's pose, columns first: yaw about y, then pitch about x, then roll about z.
Value transform(const Reading &r) {
    const double cy = std::cos(r.angles_rad[0]), sy = std::sin(r.angles_rad[0]);
    const double cp = std::cos(r.angles_rad[1]), sp = std::sin(r.angles_rad[1]);
    const double cr = std::cos(r.angles_rad[2]), sr = std::sin(r.angles_rad[2]);
    Value v;
    v.kind = REAL;
    v.count = 16;
    const double columns[16] = {
        cy * cr + sy * sp * sr, cp * sr, -sy * cr + cy * sp * sr, 0.0,
        -cy * sr + sy * sp * cr, cp * cr, sy * sr + cy * sp * cr, 0.0,
        sy * cp, -sp, cy * cp, 0.0,
        MM * r.position_m[0], MM * r.position_m[1], MM * r.position_m[2], 1.0};
    for (int i = 0; i < 16; ++i) v.numbers[i] = columns[i];
    if (std::isnan(r.position_m[0])) {
        for (int i = 0; i < 12; ++i) v.numbers[i] = r.position_m[0];
    }
    return v;
}

/// Angular velocity in the device's axes from the rates of the three angles.
Value turning(const Reading &r) {
    const double cy = std::cos(r.angles_rad[0]), sy = std::sin(r.angles_rad[0]);
    const double cp = std::cos(r.angles_rad[1]), sp = std::sin(r.angles_rad[1]);
    const Vec3 &rate = r.angular_rad_s;
    return Value(Vec3{cy * rate[1] + sy * cp * rate[2], rate[0] - sp * rate[2], -sy * rate[1] + cy * cp * rate[2]}, 1.0);
}

Value box(double x0, double y0, double z0, double x1, double y1, double z1) {
    Value v;
    v.kind = REAL;
    v.count = 6;
    const double corners[6] = {x0, y0, z0, x1, y1, z1};
    for (int i = 0; i < 6; ++i) v.numbers[i] = corners[i];
    return v;
}

Value of_reading(const Reading &r, HDenum name) {
    switch (name) {
    case HD_CURRENT_BUTTONS: return {WHOLE, static_cast<double>(r.buttons)};
    case HD_CURRENT_SAFETY_SWITCH: return {WHOLE, 1.0};
    case HD_CURRENT_INKWELL_SWITCH: return {WHOLE, 0.0};
    case HD_CURRENT_POSITION: return {r.position_m, MM};
    case HD_CURRENT_VELOCITY: return {r.velocity_m_s, MM};
    case HD_CURRENT_TRANSFORM: return transform(r);
    case HD_CURRENT_ANGULAR_VELOCITY: return turning(r);
    case HD_CURRENT_GIMBAL_ANGLES: return {r.angles_rad, 1.0};
    default: return {};
    }
}

Value of_device(const State &s, const Device &d, HDenum name) {
    switch (name) {
    case HD_CURRENT_FORCE: return {d.current.force_n, 1.0};
    case HD_CURRENT_TORQUE: return {d.current.torque_n_m, MNM};
    case HD_CURRENT_GIMBAL_TORQUE: return {d.current.gimbal_n_m, MNM};
    case HD_LAST_FORCE: return {d.last.force_n, 1.0};
    case HD_LAST_GIMBAL_TORQUE: return {d.last.gimbal_n_m, MNM};
    // The workspace of the desktop device that the numbers of the body are of.
    case HD_MAX_WORKSPACE_DIMENSIONS: return box(-210, -110, -85, 210, 205, 130);
    case HD_USABLE_WORKSPACE_DIMENSIONS: return box(-80, -60, -35, 80, 60, 35);
    case HD_TABLETOP_OFFSET: return {REAL, -110.0};
    case HD_INPUT_DOF: return {WHOLE, 6.0};
    case HD_OUTPUT_DOF: return {WHOLE, static_cast<double>(d.desc.output_dof)};
    case HD_CALIBRATION_STYLE: return {WHOLE, static_cast<double>(d.desc.calibration_style)};
    case HD_UPDATE_RATE: return {EITHER, 1.0 / s.period_s};
    case HD_INSTANTANEOUS_UPDATE_RATE: return {EITHER, 1.0 / s.last_period_s};
    case HD_NOMINAL_MAX_STIFFNESS: return {REAL, 0.5};
    case HD_NOMINAL_MAX_DAMPING: return {REAL, 0.005};
    case HD_NOMINAL_MAX_FORCE: return {REAL, d.desc.max_force_n};
    // A driven gimbal of the desktop class; a free one has no such values.
    case HD_NOMINAL_MAX_TORQUE_FORCE: return d.desc.output_dof < 6 ? Value() : Value(REAL, 515.0);
    case HD_NOMINAL_MAX_TORQUE_CONTINUOUS_FORCE: return d.desc.output_dof < 6 ? Value() : Value(REAL, 188.0);
    case HD_NOMINAL_MAX_TORQUE_STIFFNESS: return d.desc.output_dof < 6 ? Value() : Value(REAL, 1000.0);
    case HD_NOMINAL_MAX_TORQUE_DAMPING: return d.desc.output_dof < 6 ? Value() : Value(REAL, 5.0);
    case HD_NOMINAL_MAX_CONTINUOUS_FORCE: return {REAL, d.desc.continuous_force_n};
    case HD_SOFTWARE_VELOCITY_LIMIT: return {REAL, MM * d.speed_limit_m_s};
    case HD_MOTOR_TEMPERATURE: {
        Value v(REAL, d.temperature);
        v.count = 6;
        for (double &x : v.numbers) x = d.temperature;
        return v;
    }
    default: return {};
    }
}

Value value_of(const State &s, const Device &d, HDenum name) {
    // The names of the frame before lie 0x200 above those of this one.
    if (name >= HD_LAST_BUTTONS && name <= HD_LAST_GIMBAL_ANGLES) return of_reading(d.last, name - 0x200);
    const Value now = of_reading(d.current, name);
    return now.kind == UNKNOWN ? of_device(s, d, name) : now;
}

template <typename T> void get(HDenum name, T *numbers, Kind kind) {
    State &s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    const Device *device = s.current_device();
    if (!device) return;
    const Value value = value_of(s, *device, name);
    if (value.kind == UNKNOWN) {
        s.raise(HD_INVALID_ENUM, s.current);
    } else if (value.kind != kind && value.kind != EITHER) {
        s.raise(HD_INVALID_INPUT_TYPE, s.current);
    } else {
        for (int i = 0; i < value.count; ++i) numbers[i] = static_cast<T>(value.numbers[i]);
    }
}

template <typename T> void set(HDenum name, const T *numbers) {
    State &s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    Device *device = s.current_device();
    if (!device) return;
    if (name == HD_SOFTWARE_VELOCITY_LIMIT) {
        device->speed_limit_m_s = static_cast<double>(numbers[0]) / MM;
        return;
    }
    Vec3 *to = name == HD_CURRENT_FORCE           ? &device->current.force_n
               : name == HD_CURRENT_GIMBAL_TORQUE ? &device->current.gimbal_n_m
               : name == HD_CURRENT_TORQUE        ? &device->current.torque_n_m
                                                  : nullptr;
    if (!to) {
        s.raise(HD_INVALID_ENUM, s.current);
    } else if (device->depth == 0) {
        s.raise(HD_FRAME_ERROR, s.current);
    } else {
        const double scale = name == HD_CURRENT_FORCE ? 1.0 : 1.0 / MNM;
        for (int i = 0; i < 3; ++i) (*to)[i] = scale * static_cast<double>(numbers[i]);
    }
}

/// No emulated value is set by this type.
void refuse() {
    State &s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    if (s.current_device()) s.raise(HD_INVALID_INPUT_TYPE, s.current);
}

} // namespace

void HDAPIENTRY hdGetBooleanv(HDenum pname, HDboolean *params) { get(pname, params, WHOLE); }
void HDAPIENTRY hdGetIntegerv(HDenum pname, HDint *params) { get(pname, params, WHOLE); }
void HDAPIENTRY hdGetLongv(HDenum pname, HDlong *params) { get(pname, params, WHOLE); }
void HDAPIENTRY hdGetFloatv(HDenum pname, HDfloat *params) { get(pname, params, REAL); }
void HDAPIENTRY hdGetDoublev(HDenum pname, HDdouble *params) { get(pname, params, REAL); }
void HDAPIENTRY hdSetFloatv(HDenum pname, const HDfloat *params) { set(pname, params); }
void HDAPIENTRY hdSetDoublev(HDenum pname, const HDdouble *params) { set(pname, params); }
void HDAPIENTRY hdSetBooleanv(HDenum, const HDboolean *) { refuse(); }
void HDAPIENTRY hdSetIntegerv(HDenum, const HDint *) { refuse(); }
void HDAPIENTRY hdSetLongv(HDenum, const HDlong *) { refuse(); }
