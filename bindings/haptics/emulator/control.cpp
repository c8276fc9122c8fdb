// hd_emulator.h: time, hands and faults.
#include <cmath>

#include "scheduler.h"

using namespace emulator;
using Lock = std::unique_lock<std::mutex>;

namespace {

/// Does something to an open device; an unknown handle is told as HDAPI tells it.
template <typename F> void with(HHD handle, F &&change) {
    State &s = state();
    const Lock lock(s.mutex);
    if (Device *device = s.find(handle)) {
        change(s, *device);
    } else {
        s.raise(HD_BAD_HANDLE, handle);
    }
}

} // namespace

void hd_emulator_reset(void) {
    State &s = state();
    stop(s);
    const Lock lock(s.mutex);
    for (Device &device : s.devices) {
        device.is_open = false;
        device.clear();
    }
    hd_emulator_device_init(&s.next_device);
    s.current = HD_INVALID_HANDLE;
    s.error_count = 0;
    s.operations = {};
    s.is_virtual = false;
    s.period_s = s.last_period_s = 1e-3;
    s.spin_s = 50e-6;
    s.stall_s = s.tick_time_s = s.body_time_s = s.virtual_s = 0.0;
    s.tick = 0;
    s.periods.clear();
}

void hd_emulator_use_virtual_time(int on) {
    State &s = state();
    const Lock lock(s.mutex);
    if (s.is_started) {
        s.raise(HD_INVALID_OPERATION, s.current);
    } else {
        s.is_virtual = on != 0;
    }
}

std::uint64_t hd_emulator_advance(double seconds) {
    State &s = state();
    Lock lock(s.mutex);
    if (!s.is_started || !s.is_virtual || !(seconds >= 0.0) || s.servo != std::thread::id()) {
        s.raise(HD_INVALID_OPERATION, s.current);
        return 0;
    }
    const double end_s = s.virtual_s + seconds;
    std::uint64_t ticks = 0;
    for (;;) {
        if (s.stall_s > 0.0) {
            s.virtual_s += s.stall_s;
            s.stall_s = 0.0;
        }
        if (s.virtual_s + s.period_s > end_s + 1e-9) break;
        // On whole ticks, so that a long run does not drift by rounding.
        s.virtual_s = s.period_s * std::round((s.virtual_s + s.period_s) / s.period_s);
        s.last_period_s = s.virtual_s - s.tick_time_s;
        if (s.tick > 0) s.periods.add(s.last_period_s);
        tick(s, lock, s.virtual_s);
        ++ticks;
    }
    s.servo = {};
    return ticks;
}

double hd_emulator_time_s(void) {
    State &s = state();
    const Lock lock(s.mutex);
    return s.tick_time_s;
}

void hd_emulator_set_spin(double seconds) {
    State &s = state();
    const Lock lock(s.mutex);
    s.spin_s = seconds > 0.0 ? seconds : 0.0;
}

void hd_emulator_get_periods(hd_emulator_periods *periods) {
    const auto &p = state().periods;
    *periods = {p.count(),     p.quantile_s(0.5), p.quantile_s(0.99), p.quantile_s(0.999),
                p.max_s(),     p.over_late(),     p.over_missed(),    p.longest_run()};
}

void hd_emulator_device_init(hd_emulator_device *device) {
    *device = {0.045, 0.02, 0.26, 0.055e-3, 0.010, 0.15, 300.0, 5.0, 3.3, 0.88, 1.5, 0.020, 3, HD_CALIBRATION_INKWELL};
}

void hd_emulator_set_device(HHD hHD, const hd_emulator_device *device) {
    with(hHD, [device](State &s, Device &d) {
        d.desc = *device;
        d.speed_limit_m_s = device->max_speed_m_s;
        d.encoders.clear();
        d.encoders.sample(d.desc, d.body.position_m, s.body_time_s);
    });
}

void hd_emulator_set_next_device(const hd_emulator_device *device) {
    State &s = state();
    const Lock lock(s.mutex);
    s.next_device = *device;
}

void hd_emulator_set_hand(HHD hHD, hd_emulator_hand_fn hand, void *user) {
    with(hHD, [hand, user](State &, Device &d) { d.hand.follow(hand, user); });
}

void hd_emulator_motion_init(hd_emulator_motion *motion, int kind) {
    *motion = {kind, {0, 0, 0}, {0, 0, -1}, 0.020, 0.05, 0.5, {0.02, 0, 0}, 0.5e-3, 9.0, 1, 0.0};
    if (kind == HD_EMULATOR_RANDOM) {
        motion->amplitude_m = 0.02;
        motion->frequency_hz = 1.0;
    }
}

void hd_emulator_set_motion(HHD hHD, const hd_emulator_motion *motion) {
    with(hHD, [motion](State &, Device &d) { d.hand.follow(*motion); });
}

int hd_emulator_load_motion(HHD hHD, const char *path) {
    int read = 0;
    with(hHD, [path, &read](State &, Device &d) { read = d.hand.follow_file(path) ? 1 : 0; });
    return read;
}

void hd_emulator_place(HHD hHD, const double *position_m) {
    with(hHD, [position_m](State &s, Device &d) {
        d.body = {{position_m[0], position_m[1], position_m[2]}, {}};
        d.encoders.clear();
        d.encoders.sample(d.desc, d.body.position_m, s.body_time_s);
    });
}

void hd_emulator_get_truth(HHD hHD, hd_emulator_truth *truth) {
    *truth = {};
    with(hHD, [truth](State &, Device &d) {
        for (int i = 0; i < 3; ++i) {
            truth->position_m[i] = d.body.position_m[i];
            truth->velocity_m_s[i] = d.body.velocity_m_s[i];
            truth->target_m[i] = d.target.position_m[i];
            truth->force_n[i] = d.motor_force_n[i];
            truth->torque_n_m[i] = d.motor_torque_n_m[i];
        }
        truth->frames = d.frames;
    });
}

void hd_emulator_inject_nan(HHD hHD, unsigned ticks) {
    with(hHD, [ticks](State &, Device &d) { d.nan_frames = ticks; });
}

void hd_emulator_inject_jump(HHD hHD, const double *offset_m) {
    with(hHD, [offset_m](State &, Device &d) { d.offset_m = {offset_m[0], offset_m[1], offset_m[2]}; });
}

void hd_emulator_inject_error(HHD hHD, HDerror error, unsigned ticks) {
    with(hHD, [error, ticks](State &, Device &d) {
        d.error = error;
        d.error_frames = ticks;
    });
}

void hd_emulator_set_calibration(HHD hHD, HDenum calibration) {
    with(hHD, [calibration](State &, Device &d) { d.calibration = calibration; });
}

void hd_emulator_set_buttons(HHD hHD, int buttons) {
    with(hHD, [buttons](State &, Device &d) { d.buttons = buttons; });
}

void hd_emulator_set_temperature(HHD hHD, double temperature) {
    with(hHD, [temperature](State &, Device &d) { d.temperature = temperature; });
}

void hd_emulator_stall(double seconds) {
    State &s = state();
    const Lock lock(s.mutex);
    s.stall_s = seconds > 0.0 ? seconds : 0.0;
}
