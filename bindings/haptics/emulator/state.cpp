#include "state.h"

#include <cmath>

namespace emulator {

void Device::clear() {
    const bool was_open = is_open;
    hd_emulator_device_init(&desc);
    hand = Hand();
    target = {};
    body = {};
    encoders.clear();
    angles_before = angular_rad_s = {};
    is_on = {false, false, false, true, true}; // the software force limit and one frame a tick, as in the SDK
    calibration = HD_CALIBRATION_OK;
    buttons = 0;
    temperature = 0.0;
    speed_limit_m_s = desc.max_speed_m_s;
    nan_frames = error_frames = 0;
    error = HD_SUCCESS;
    offset_m = {};
    depth = 0;
    ended_in_tick = frames = 0;
    current = last = {};
    motor_force_n = motor_torque_n_m = {};
    motor_time_s = 0.0;
    is_open = was_open;
}

Device *State::find(HHD handle) {
    const HHD index = handle - FIRST_HANDLE;
    return index < DEVICES && devices[index].is_open ? &devices[index] : nullptr;
}

Device *State::current_device() {
    Device *device = find(current);
    if (!device) raise(HD_BAD_HANDLE, current);
    return device;
}

void State::raise(HDerror code, HHD handle) {
    if (error_count == ERRORS) {
        for (unsigned i = 1; i < ERRORS; ++i) errors[i - 1] = errors[i];
        --error_count;
    }
    errors[error_count++] = {code, 0, handle};
}

HHD State::handle_of(const Device &device) const {
    return FIRST_HANDLE + static_cast<HHD>(&device - devices.data());
}

State &state() {
    static State *const all = new State;
    return *all;
}

void pass_time(State &s, double until_s) {
    // After a long stall the hand has long settled: integrating more than a second of it only makes the stall longer.
    if (until_s - s.body_time_s > 1.0) s.body_time_s = until_s - 1.0;
    const double begin_s = s.body_time_s;
    const auto steps = static_cast<std::uint64_t>(std::floor((until_s - begin_s) / BODY_STEP_S + 0.5));
    for (Device &device : s.devices) {
        if (!device.is_open) continue;
        for (std::uint64_t i = 0; i < steps; ++i) {
            const double time_s = begin_s + static_cast<double>(i + 1) * BODY_STEP_S;
            if (device.hand.holds()) device.hand.target(time_s, &device.target);
            if (time_s - device.motor_time_s > device.desc.watchdog_s) device.motor_force_n = device.motor_torque_n_m = {};
            device.body.step(device.desc, device.hand.holds() ? &device.target : nullptr, device.motor_force_n,
                             BODY_STEP_S);
        }
        if (steps == 0) continue;
        const double passed_s = static_cast<double>(steps) * BODY_STEP_S;
        for (int i = 0; i < 3; ++i) {
            device.angular_rad_s[i] = (device.target.angles_rad[i] - device.angles_before[i]) / passed_s;
            device.angles_before[i] = device.target.angles_rad[i];
        }
        device.encoders.sample(device.desc, device.body.position_m, begin_s + passed_s);
    }
    s.body_time_s = begin_s + static_cast<double>(steps) * BODY_STEP_S;
}

} // namespace emulator
