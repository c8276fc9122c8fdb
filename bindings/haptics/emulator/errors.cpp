// The error stack, and what errors are called.
#include "state.h"

using emulator::state;

HDErrorInfo HDAPIENTRY hdGetError(void) {
    auto &s = state();
    const std::lock_guard<std::mutex> lock(s.mutex);
    if (s.error_count == 0) return {HD_SUCCESS, 0, HD_INVALID_HANDLE};
    return s.errors[--s.error_count];
}

HDstring HDAPIENTRY hdGetErrorString(HDerror errorCode) {
    switch (errorCode) {
    case HD_SUCCESS: return "no error";
    case HD_INVALID_ENUM: return "this name is not known to this call";
    case HD_INVALID_VALUE: return "this value is not possible";
    case HD_INVALID_OPERATION: return "this is not possible now";
    case HD_INVALID_INPUT_TYPE: return "this name has values of another type";
    case HD_BAD_HANDLE: return "this is no open device";
    case HD_WARM_MOTORS: return "the motors are warm";
    case HD_EXCEEDED_MAX_FORCE: return "the force is larger than the device can give";
    case HD_EXCEEDED_MAX_FORCE_IMPULSE: return "the force changes faster than allowed";
    case HD_EXCEEDED_MAX_VELOCITY: return "the device moves faster than allowed";
    case HD_FORCE_ERROR: return "the force is not a number";
    case HD_DEVICE_FAULT: return "the device failed, or is not there";
    case HD_DEVICE_ALREADY_INITIATED: return "the device is open already";
    case HD_COMM_ERROR: return "the device does not answer";
    case HD_COMM_CONFIG_ERROR: return "the device's connection is set up wrongly";
    case HD_TIMER_ERROR: return "the servo loop cannot be started or stopped";
    case HD_ILLEGAL_BEGIN: return "this tick had its frame already";
    case HD_ILLEGAL_END: return "there is no frame to end";
    case HD_FRAME_ERROR: return "this needs a frame, or a frame was not ended";
    case HD_INVALID_PRIORITY: return "this is no priority";
    case HD_SCHEDULER_FULL: return "the scheduler has no room for another callback";
    case HD_INVALID_LICENSE: return "there is no licence";
    default: return "unknown error";
    }
}
