// Frames: what a servo callback reads is one moment, and what it writes goes out together.
#include <cmath>
#include <limits>

#include "state.h"

using namespace emulator;

namespace {

double length(const Vec3 &v) { return std::hypot(v[0], v[1], v[2]); }

bool is_finite(const Vec3 &v) { return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]); }

/// Shortens a vector; its direction stays.
void limit(Vec3 &v, double most) {
    const double now = length(v);
    if (now > most) {
        for (double &x : v) x *= most / now;
    }
}

/// Looks at the device, and breaks what is to be broken.
void read(State &s, Device &device) {
    device.last = device.current;
    Reading &now = device.current;
    now.position_m = device.encoders.position_m();
    now.velocity_m_s = device.encoders.velocity_m_s();
    for (int i = 0; i < 3; ++i) now.position_m[i] += device.offset_m[i];
    for (int i = 0; i < 3; ++i) now.angles_rad[i] = device.target.angles_rad[i];
    now.angular_rad_s = device.angular_rad_s;
    now.buttons = device.buttons;

    if (device.nan_frames > 0) {
        --device.nan_frames;
        now.position_m.fill(std::numeric_limits<double>::quiet_NaN());
        now.velocity_m_s = now.position_m;
    }
    const HHD handle = s.handle_of(device);
    if (device.error_frames > 0) {
        --device.error_frames;
        s.raise(device.error, handle);
    }
    if (device.temperature >= 0.9) s.raise(HD_WARM_MOTORS, handle);
    if (length(now.velocity_m_s) > device.speed_limit_m_s) s.raise(HD_EXCEEDED_MAX_VELOCITY, handle);
}

/// Gives the motors what the frame asked for, as far as they can.
void write(State &s, Device &device) {
    const HHD handle = s.handle_of(device);
    Vec3 &force = device.current.force_n, &torque = device.current.gimbal_n_m;
    if (!is_finite(force) || !is_finite(torque)) {
        s.raise(HD_FORCE_ERROR, handle);
        force = torque = {};
    }
    const bool clamps = device.is_on[HD_MAX_FORCE_CLAMPING - HD_FORCE_OUTPUT];
    const bool watches = device.is_on[HD_SOFTWARE_FORCE_LIMIT - HD_FORCE_OUTPUT];
    if (length(force) > device.desc.max_force_n * (1.0 + 1e-9) && watches && !clamps) {
        s.raise(HD_EXCEEDED_MAX_FORCE, handle);
    }
    limit(force, device.desc.max_force_n); // no setting makes motors stronger

    const bool is_on = device.is_on[0] && s.is_started;
    device.motor_force_n = is_on ? force : Vec3{};
    device.motor_torque_n_m = is_on && device.desc.output_dof == 6 ? torque : Vec3{};
    device.motor_time_s = s.body_time_s;
    ++device.frames;
}

} // namespace

void HDAPIENTRY hdBeginFrame(HHD hHD) {
    State &s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    Device *device = s.find(hHD);
    if (!device) {
        s.raise(HD_BAD_HANDLE, hHD);
        return;
    }
    s.current = hHD;
    // Without a running scheduler there are no ticks that could have had their frame.
    if (device->depth == 0 && s.is_started && device->ended_in_tick == s.tick && s.tick > 0 &&
        device->is_on[HD_ONE_FRAME_LIMIT - HD_FORCE_OUTPUT]) {
        s.raise(HD_ILLEGAL_BEGIN, hHD);
        return;
    }
    if (device->depth++ == 0) read(s, *device);
}

void HDAPIENTRY hdEndFrame(HHD hHD) {
    State &s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    Device *device = s.find(hHD);
    if (!device || device->depth == 0) {
        s.raise(device ? HD_ILLEGAL_END : HD_BAD_HANDLE, hHD);
        return;
    }
    s.current = hHD;
    if (--device->depth > 0) return;
    write(s, *device);
    device->ended_in_tick = s.tick;
}
