// The emulator behaves as HDAPI: frames, units, the error stack, callbacks and their order, limits, calibration.
#include <cmath>
#include <cstring>
#include <limits>
#include <string>

#include "scene.h"

namespace {

/// The newest error must be this one.
#define ERROR_IS(code)                                                                                                \
    do {                                                                                                              \
        const HDErrorInfo found = hdGetError();                                                                       \
        if (found.errorCode != (code)) {                                                                              \
            std::fprintf(stderr, "%s:%d: 0x%04x is not %s\n", __FILE__, __LINE__, found.errorCode, #code);           \
            std::exit(1);                                                                                             \
        }                                                                                                             \
    } while (0)

HHD open_virtual() {
    hd_emulator_reset();
    hd_emulator_use_virtual_time(1);
    const HHD device = hdInitDevice(HD_DEFAULT_DEVICE);
    ERROR_IS(HD_SUCCESS);
    return device;
}

/// Runs a function once in the next tick.
template <typename F> void in_tick(F work) {
    hdScheduleAsynchronous(
        [](void *user) -> HDCallbackCode {
            (*static_cast<F *>(user))();
            return HD_CALLBACK_DONE;
        },
        &work, HD_DEFAULT_SCHEDULER_PRIORITY);
    CHECK(hd_emulator_advance(1e-3) == 1);
}

void devices_open_once_and_by_name() {
    hd_emulator_reset();
    CHECK(hdGetCurrentDevice() == HD_INVALID_HANDLE);
    ERROR_IS(HD_BAD_HANDLE);
    const HHD left = hdInitDevice("Left Device"), first = hdInitDevice(HD_DEFAULT_DEVICE);
    CHECK(left != first && left != 0 && first != 0 && hdGetCurrentDevice() == first);
    CHECK(hdInitDevice("Left Device") == HD_INVALID_HANDLE);
    ERROR_IS(HD_DEVICE_ALREADY_INITIATED);
    CHECK(hdInitDevice("no such device") == HD_INVALID_HANDLE);
    ERROR_IS(HD_DEVICE_FAULT);
    hdDisableDevice(left);
    hdMakeCurrentDevice(left);
    ERROR_IS(HD_BAD_HANDLE);
    ERROR_IS(HD_SUCCESS);
    CHECK(std::strlen(hdGetString(HD_DEVICE_MODEL_TYPE)) > 0);
}

void errors_come_newest_first_and_name_their_device() {
    const HHD device = open_virtual();
    double x[16];
    int n;
    hdGetDoublev(0x1234, x);
    hdGetDoublev(HD_CURRENT_BUTTONS, x);
    hdGetIntegerv(HD_CURRENT_POSITION, &n);
    hdEndFrame(device);
    const HDErrorInfo newest = hdGetError();
    CHECK(newest.errorCode == HD_ILLEGAL_END && newest.hHD == device && HD_DEVICE_ERROR(newest));
    ERROR_IS(HD_INVALID_INPUT_TYPE);
    ERROR_IS(HD_INVALID_INPUT_TYPE);
    ERROR_IS(HD_INVALID_ENUM);
    ERROR_IS(HD_SUCCESS);
    for (int i = 0; i < 1000; ++i) hdEndFrame(device); // the stack is bounded
    int kept = 0;
    while (HD_DEVICE_ERROR(hdGetError())) ++kept;
    CHECK(kept == 32);
    for (HDerror code = 0; code <= 0x0600; ++code) CHECK(hdGetErrorString(code)[0] != 0);
}

void a_force_needs_a_frame_and_a_tick_has_one() {
    const HHD device = open_virtual();
    const double force[3] = {0.5, 0.0, 0.0};
    hdSetDoublev(HD_CURRENT_FORCE, force);
    ERROR_IS(HD_FRAME_ERROR);
    hdEnable(HD_FORCE_OUTPUT);
    hdStartScheduler();
    in_tick([&] {
        hdBeginFrame(device);
        hdBeginFrame(device); // nested
        hdSetDoublev(HD_CURRENT_FORCE, force);
        hdEndFrame(device);
        hd_emulator_truth truth;
        hd_emulator_get_truth(device, &truth);
        CHECK(truth.force_n[0] == 0.0); // only the outer end writes
        hdEndFrame(device);
        hd_emulator_get_truth(device, &truth);
        CHECK(truth.force_n[0] == 0.5);
        ERROR_IS(HD_SUCCESS);
        hdBeginFrame(device);
        ERROR_IS(HD_ILLEGAL_BEGIN);
        hdDisable(HD_ONE_FRAME_LIMIT);
        hdBeginFrame(device);
        hdEndFrame(device);
        ERROR_IS(HD_SUCCESS);
    });
    in_tick([&] { hdBeginFrame(device); }); // and never ends it
    ERROR_IS(HD_FRAME_ERROR);
    hd_emulator_truth truth;
    hd_emulator_get_truth(device, &truth);
    CHECK(length(truth.force_n) == 0.0);
    in_tick([&] {
        hdBeginFrame(device);
        hdSetDoublev(HD_CURRENT_FORCE, force);
        hdEndFrame(device);
    });
    hd_emulator_advance(0.015);
    hd_emulator_get_truth(device, &truth);
    CHECK(truth.force_n[0] == 0.5); // motors hold what they were told last,
    hd_emulator_advance(0.015);
    hd_emulator_get_truth(device, &truth);
    CHECK(truth.force_n[0] == 0.0); // but not for ever
}

void values_are_in_millimetres_and_columns() {
    const HHD device = open_virtual();
    hd_emulator_set_hand(
        device,
        [](void *, double time_s, hd_emulator_target *target) {
            target->position_m[0] = 0.010;
            target->position_m[1] = 0.020;
            target->position_m[2] = -0.030;
            target->angles_rad[0] = 0.3 + 0.1 * time_s;
            target->angles_rad[1] = -0.2;
            target->angles_rad[2] = 0.5;
        },
        nullptr);
    const double place[3] = {0.010, 0.020, -0.030};
    hd_emulator_place(device, place);
    hd_emulator_set_buttons(device, HD_DEVICE_BUTTON_2);
    hdStartScheduler();
    hd_emulator_advance(0.1);
    double m[16], position[3], gimbal[3], turning[3], box[6], stiffness;
    float rounded[3];
    int buttons, dof;
    hdBeginFrame(device);
    hdGetDoublev(HD_CURRENT_TRANSFORM, m);
    hdGetDoublev(HD_CURRENT_POSITION, position);
    hdGetFloatv(HD_CURRENT_POSITION, rounded);
    hdGetDoublev(HD_CURRENT_GIMBAL_ANGLES, gimbal);
    hdGetDoublev(HD_CURRENT_ANGULAR_VELOCITY, turning);
    hdGetIntegerv(HD_CURRENT_BUTTONS, &buttons);
    hdEndFrame(device);
    hdGetIntegerv(HD_OUTPUT_DOF, &dof);
    hdGetDoublev(HD_USABLE_WORKSPACE_DIMENSIONS, box);
    hdGetDoublev(HD_NOMINAL_MAX_STIFFNESS, &stiffness);
    ERROR_IS(HD_SUCCESS);
    for (int i = 0; i < 3; ++i) {
        NEAR(position[i], 1e3 * place[i], 0.0276); // half an encoder step
        NEAR(m[12 + i], position[i], 0.0);
        NEAR(rounded[i], position[i], 1e-5);
    }
    // The stylus's z axis: yaw and pitch alone turn it.
    NEAR(gimbal[0], 0.31, 1e-4);
    NEAR(m[8], std::sin(gimbal[0]) * std::cos(gimbal[1]), 1e-12);
    NEAR(m[9], -std::sin(gimbal[1]), 1e-12);
    NEAR(m[10], std::cos(gimbal[0]) * std::cos(gimbal[1]), 1e-12);
    NEAR(turning[0], 0.0, 1e-9); // yaw turns about y
    NEAR(turning[1], 0.1, 1e-9);
    CHECK(m[3] == 0.0 && m[15] == 1.0 && buttons == HD_DEVICE_BUTTON_2 && dof == 3);
    CHECK(box[0] == -80.0 && box[5] == 35.0 && stiffness == 0.5);
    double last[3];
    hdGetDoublev(HD_LAST_POSITION, last);
    CHECK(hdGetError().errorCode == HD_SUCCESS);
}

void a_force_above_the_maximum_is_an_error_and_limited() {
    const HHD device = open_virtual();
    hdEnable(HD_FORCE_OUTPUT);
    hdStartScheduler();
    const double strong[3] = {3.0, 4.0, 0.0}, none[3] = {std::numeric_limits<double>::quiet_NaN(), 0.0, 0.0};
    hd_emulator_truth truth;
    const auto command = [&](const double *force) {
        in_tick([&] {
            hdBeginFrame(device);
            hdSetDoublev(HD_CURRENT_FORCE, force);
            hdEndFrame(device);
        });
        hd_emulator_get_truth(device, &truth);
    };
    command(strong);
    ERROR_IS(HD_EXCEEDED_MAX_FORCE);
    NEAR(length(truth.force_n), 3.3, 1e-12);
    NEAR(truth.force_n[0] / truth.force_n[1], 0.75, 1e-12); // shortened, not bent
    hdEnable(HD_MAX_FORCE_CLAMPING);
    command(strong);
    ERROR_IS(HD_SUCCESS);
    NEAR(length(truth.force_n), 3.3, 1e-12);
    command(none);
    ERROR_IS(HD_FORCE_ERROR);
    CHECK(length(truth.force_n) == 0.0);
    hdDisable(HD_FORCE_OUTPUT);
    command(strong);
    CHECK(length(truth.force_n) == 0.0);
}

void callbacks_run_by_priority_until_they_are_done() {
    open_virtual();
    static std::string order;
    static HDSchedulerHandle again;
    order.clear();
    hdScheduleAsynchronous([](void *) -> HDCallbackCode { return order += 'l', HD_CALLBACK_DONE; }, nullptr, 1);
    again = hdScheduleAsynchronous([](void *) -> HDCallbackCode { return order += 'h', HD_CALLBACK_CONTINUE; }, nullptr,
                                   HD_MAX_SCHEDULER_PRIORITY);
    hdScheduleAsynchronous([](void *) -> HDCallbackCode { return order += 'm', HD_CALLBACK_DONE; }, nullptr, 7);
    hdScheduleAsynchronous([](void *) -> HDCallbackCode { return order += 'n', HD_CALLBACK_DONE; }, nullptr, 7);
    hdScheduleSynchronous([](void *) -> HDCallbackCode { return order += 's', HD_CALLBACK_DONE; }, nullptr, 0);
    CHECK(order == "s"); // at once where nothing runs
    hdStartScheduler();
    hdStartScheduler();
    ERROR_IS(HD_TIMER_ERROR);
    CHECK(hd_emulator_advance(0.003) == 3);
    CHECK(order == "shmnlhh");
    CHECK(hdWaitForCompletion(again, HD_WAIT_CHECK_STATUS) == HD_TRUE);
    hdUnschedule(again);
    CHECK(hdWaitForCompletion(again, HD_WAIT_CHECK_STATUS) == HD_FALSE);
    hdUnschedule(again);
    ERROR_IS(HD_INVALID_OPERATION);
    hd_emulator_advance(0.003);
    CHECK(order == "shmnlhh");
    HDSchedulerHandle handle = 0;
    for (int i = 0; i < 64; ++i) {
        handle = hdScheduleAsynchronous([](void *) -> HDCallbackCode { return HD_CALLBACK_CONTINUE; }, nullptr, 0);
        CHECK(handle != HD_INVALID_HANDLE);
    }
    CHECK(hdScheduleAsynchronous([](void *) -> HDCallbackCode { return 0; }, nullptr, 0) == HD_INVALID_HANDLE);
    ERROR_IS(HD_SCHEDULER_FULL);
    hdSetSchedulerRate(3);
    ERROR_IS(HD_INVALID_VALUE);
    hdSetSchedulerRate(500);
    CHECK(hd_emulator_advance(0.010) == 5);
}

void synchronous_callbacks_run_on_the_scheduler_thread_and_are_waited_for() {
    hd_emulator_reset();
    hdInitDevice(HD_DEFAULT_DEVICE);
    hdStartScheduler();
    ERROR_IS(HD_SUCCESS);
    int value = 0;
    hdScheduleSynchronous(
        [](void *user) -> HDCallbackCode {
            // Within the servo thread another one runs at once: it cannot wait for itself.
            hdScheduleSynchronous([](void *inner) -> HDCallbackCode { return ++*static_cast<int *>(inner), 0; }, user, 0);
            return ++*static_cast<int *>(user) < 4 ? HD_CALLBACK_CONTINUE : HD_CALLBACK_DONE;
        },
        &value, 0);
    CHECK(value == 4);
    hdScheduleSynchronous([](void *) -> HDCallbackCode { return hdStopScheduler(), 0; }, nullptr, 0);
    ERROR_IS(HD_INVALID_OPERATION); // a thread cannot wait for its own end
    const HDSchedulerHandle once =
        hdScheduleAsynchronous([](void *user) -> HDCallbackCode { return ++*static_cast<int *>(user), 0; }, &value, 0);
    CHECK(hdWaitForCompletion(once, HD_WAIT_INFINITE) == HD_TRUE);
    CHECK(value == 5);
    hdStopScheduler();
    hdStopScheduler();
    ERROR_IS(HD_SUCCESS);
}

void calibration_is_lost_and_found() {
    const HHD device = open_virtual();
    CHECK(hdCheckCalibration() == HD_CALIBRATION_OK);
    hd_emulator_set_calibration(device, HD_CALIBRATION_NEEDS_UPDATE);
    CHECK(hdCheckCalibration() == HD_CALIBRATION_NEEDS_UPDATE);
    hdUpdateCalibration(HD_CALIBRATION_AUTO); // not what this device can
    ERROR_IS(HD_DEVICE_FAULT);
    hdUpdateCalibration(HD_CALIBRATION_INKWELL);
    CHECK(hdCheckCalibration() == HD_CALIBRATION_OK);
    hd_emulator_set_calibration(device, HD_CALIBRATION_NEEDS_MANUAL_INPUT);
    hdUpdateCalibration(HD_CALIBRATION_INKWELL);
    ERROR_IS(HD_DEVICE_FAULT);
}

void faults_are_injected_for_as_long_as_asked() {
    const HHD device = open_virtual();
    hdStartScheduler();
    const auto frame = [&] {
        double x[3];
        in_tick([&] {
            hdBeginFrame(device);
            hdGetDoublev(HD_CURRENT_POSITION, x);
            hdEndFrame(device);
        });
        return x[0];
    };
    hd_emulator_inject_nan(device, 2);
    CHECK(std::isnan(frame()) && std::isnan(frame()) && !std::isnan(frame()));
    const double far[3] = {0.1, 0.0, 0.0}, back[3] = {0.0, 0.0, 0.0};
    hd_emulator_inject_jump(device, far);
    NEAR(frame(), 100.0, 1e-9);
    hd_emulator_inject_jump(device, back);
    NEAR(frame(), 0.0, 1e-9);
    hd_emulator_inject_error(device, HD_COMM_ERROR, 1);
    frame();
    ERROR_IS(HD_COMM_ERROR);
    frame();
    ERROR_IS(HD_SUCCESS);
    hd_emulator_set_temperature(device, 0.95);
    frame();
    ERROR_IS(HD_WARM_MOTORS);
    hd_emulator_set_temperature(device, 0.1);
    const double before_s = hd_emulator_time_s();
    hd_emulator_stall(0.050);
    CHECK(hd_emulator_advance(0.052) == 2); // nothing runs in the stall
    NEAR(hd_emulator_time_s() - before_s, 0.052, 1e-9);
}

} // namespace

int main() {
    devices_open_once_and_by_name();
    errors_come_newest_first_and_name_their_device();
    a_force_needs_a_frame_and_a_tick_has_one();
    values_are_in_millimetres_and_columns();
    a_force_above_the_maximum_is_an_error_and_limited();
    callbacks_run_by_priority_until_they_are_done();
    synchronous_callbacks_run_on_the_scheduler_thread_and_are_waited_for();
    calibration_is_lost_and_found();
    faults_are_injected_for_as_long_as_asked();
    hd_emulator_reset();
    std::puts("emulator rules: ok");
}
