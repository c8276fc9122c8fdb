// Opening, switching and calibrating devices.
#include <cstring>

#include "state.h"

using namespace emulator;

namespace {

/// The configurations that hdInitDevice knows; the first is the default device.
const char *const NAMES[DEVICES] = {"Default Device", "Left Device", "Right Device"};

/// The place of a capability in Device::is_on, or none.
int place_of(HDenum cap) {
    return cap >= HD_FORCE_OUTPUT && cap <= HD_ONE_FRAME_LIMIT ? static_cast<int>(cap - HD_FORCE_OUTPUT) : -1;
}

void enable(HDenum cap, bool on) {
    State &s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    Device *device = s.current_device();
    if (!device) return;
    const int place = place_of(cap);
    if (place < 0) {
        s.raise(HD_INVALID_ENUM, s.current);
        return;
    }
    device->is_on[place] = on;
    if (cap == HD_FORCE_OUTPUT && !on) device->motor_force_n = device->motor_torque_n_m = {};
}

} // namespace

HHD HDAPIENTRY hdInitDevice(HDstring pConfigName) {
    State &s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    for (unsigned i = 0; i < DEVICES; ++i) {
        Device &device = s.devices[i];
        // Without a name it is the first that is not open yet.
        const bool fits = pConfigName ? std::strcmp(pConfigName, NAMES[i]) == 0 : !device.is_open;
        if (!fits) continue;
        if (device.is_open) {
            s.raise(HD_DEVICE_ALREADY_INITIATED, s.handle_of(device));
            return HD_INVALID_HANDLE;
        }
        device.clear();
        device.desc = s.next_device;
        device.speed_limit_m_s = device.desc.max_speed_m_s;
        device.is_open = true;
        device.encoders.sample(device.desc, device.body.position_m, s.body_time_s);
        s.current = s.handle_of(device);
        return s.current;
    }
    s.raise(HD_DEVICE_FAULT, HD_INVALID_HANDLE);
    return HD_INVALID_HANDLE;
}

void HDAPIENTRY hdDisableDevice(HHD hHD) {
    State &s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    Device *device = s.find(hHD);
    if (!device) {
        s.raise(HD_BAD_HANDLE, hHD);
        return;
    }
    device->clear();
    device->is_open = false;
    if (s.current == hHD) s.current = HD_INVALID_HANDLE;
}

void HDAPIENTRY hdMakeCurrentDevice(HHD hHD) {
    State &s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    if (s.find(hHD)) {
        s.current = hHD;
    } else {
        s.raise(HD_BAD_HANDLE, hHD);
    }
}

HHD HDAPIENTRY hdGetCurrentDevice(void) {
    State &s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    if (s.current == HD_INVALID_HANDLE) s.raise(HD_BAD_HANDLE, s.current);
    return s.current;
}

void HDAPIENTRY hdEnable(HDenum cap) { enable(cap, true); }

void HDAPIENTRY hdDisable(HDenum cap) { enable(cap, false); }

HDboolean HDAPIENTRY hdIsEnabled(HDenum cap) {
    State &s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    Device *device = s.current_device();
    if (!device) return HD_FALSE;
    const int place = place_of(cap);
    if (place < 0) s.raise(HD_INVALID_ENUM, s.current);
    return place >= 0 && device->is_on[place] ? HD_TRUE : HD_FALSE;
}

HDenum HDAPIENTRY hdCheckCalibration(void) {
    State &s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    const Device *device = s.current_device();
    return device ? device->calibration : HD_CALIBRATION_NEEDS_MANUAL_INPUT;
}

void HDAPIENTRY hdUpdateCalibration(HDenum style) {
    State &s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    Device *device = s.current_device();
    if (!device) return;
    // A device that wants a hand (its stylus put into the inkwell) cannot be helped by a call.
    if ((static_cast<int>(style) & device->desc.calibration_style) == 0 ||
        device->calibration == HD_CALIBRATION_NEEDS_MANUAL_INPUT) {
        s.raise(HD_DEVICE_FAULT, s.current);
        return;
    }
    device->calibration = HD_CALIBRATION_OK;
}

HDstring HDAPIENTRY hdGetString(HDenum pname) {
    State &s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    const Device *device = s.current_device();
    if (!device) return "";
    switch (pname) {
    case HD_VERSION: return "emulator";
    case HD_DEVICE_MODEL_TYPE: return device->desc.output_dof == 6 ? "Emulated device, 6 DOF" : "Emulated device, 3 DOF";
    case HD_DEVICE_DRIVER_VERSION: return "emulator";
    case HD_DEVICE_VENDOR: return "palpate";
    case HD_DEVICE_SERIAL_NUMBER: return NAMES[s.current - FIRST_HANDLE];
    default: s.raise(HD_INVALID_ENUM, s.current); return "";
    }
}
