// The host's side: opening, starting, stopping, closing. Nothing here runs on a servo thread but short callbacks.
#include "palpate_hdapi.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <iterator>
#include <mutex>
#include <thread>

#include "port.h"

using namespace palpate_hd;

plp_hd palpate_hd::ports[PLP_HD_PORTS];

namespace {

static_assert((1u << 7) == PLP_HD_FAULT_BUSY, "its place in fault_ticks");
static_assert(Periods::BUCKETS == PLP_HD_PERIOD_BUCKETS, "statistics copy the buckets");

/// Host functions of all ports take turns: they share the array of ports and the one scheduler.
std::mutex host;
/// Ports that the bridge's scheduler runs for.
int scheduled_ports = 0;
/// In so many seconds any force is gone at the slew limit: a little less than the 30 ms that plp_haptic_desc asks for.
constexpr double FALL_S = 0.029;

/// Errors of HDAPI that one port found and that belong to another, by its place.
std::atomic<std::uint32_t> kept_errors[PLP_HD_PORTS];

thread_local char last_error[512] = "";

plp_status fail(plp_status status, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    std::vsnprintf(last_error, sizeof last_error, format, arguments);
    va_end(arguments);
    return status;
}

plp_status check(const plp_hd *port) {
    if (!port) return fail(PLP_ERR_NULL, "the port is NULL");
    for (const plp_hd &p : ports) {
        if (&p == port && p.is_open.load()) return PLP_OK;
    }
    return fail(PLP_ERR_INVALID_HANDLE, "the port is closed, or was never one");
}

/// Writes an output that may have grown since the caller was compiled.
template <typename T> plp_status give(const T &value, T *to, std::uint32_t size) {
    if (!to) return fail(PLP_ERR_NULL, "the output is NULL");
    if (size < sizeof(T)) return fail(PLP_ERR_STRUCT_SIZE, "the output's size is %u, not %zu", size, sizeof(T));
    std::memcpy(to, &value, sizeof value);
    return PLP_OK;
}

/// Does something where HDAPI wants it: on the servo thread between callbacks, or here where no scheduler runs.
template <typename F> void in_servo(F &&work) {
    using Work = std::remove_reference_t<F>;
    hdScheduleSynchronous(
        [](void *user) -> HDCallbackCode {
            return (*static_cast<Work *>(user))() ? HD_CALLBACK_DONE : HD_CALLBACK_CONTINUE;
        },
        &work, HD_MIN_SCHEDULER_PRIORITY);
}

/// Waits until no tick is under way that could still see what was before. False after a second: someone is stuck in one.
bool wait_outside(const plp_hd &port) {
    const std::uint32_t before = port.inside.load();
    for (int i = 0; before % 2 == 1 && port.inside.load() == before; ++i) {
        if (i == 1000) return false;
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return true;
}

void copy_text(char *to, std::size_t size, HDstring from) { std::snprintf(to, size, "%s", from ? from : ""); }

void copy_mm(const double *mm, double *m) {
    for (int i = 0; i < 3; ++i) m[i] = 1e-3 * mm[i];
}

/// Asks the current device what it is.
void ask(plp_hd_info &info) {
    double box[6] = {};
    copy_text(info.model, sizeof info.model, hdGetString(HD_DEVICE_MODEL_TYPE));
    copy_text(info.serial, sizeof info.serial, hdGetString(HD_DEVICE_SERIAL_NUMBER));
    hdGetDoublev(HD_NOMINAL_MAX_FORCE, &info.max_force_n);
    hdGetDoublev(HD_NOMINAL_MAX_CONTINUOUS_FORCE, &info.continuous_force_n);
    hdGetDoublev(HD_NOMINAL_MAX_STIFFNESS, &info.max_stiffness_n_m);
    hdGetDoublev(HD_NOMINAL_MAX_DAMPING, &info.max_damping_n_s_m);
    info.max_stiffness_n_m *= 1e3; // from N/mm
    info.max_damping_n_s_m *= 1e3; // from N s/mm
    hdGetDoublev(HD_UPDATE_RATE, &info.servo_rate_hz);
    if (!(info.servo_rate_hz > 0.0)) info.servo_rate_hz = 1000.0; // as HDAPI's scheduler is without another word
    hdGetDoublev(HD_MAX_WORKSPACE_DIMENSIONS, box);
    copy_mm(box, info.reach_min_m);
    copy_mm(box + 3, info.reach_max_m);
    hdGetDoublev(HD_USABLE_WORKSPACE_DIMENSIONS, box);
    copy_mm(box, info.usable_min_m);
    copy_mm(box + 3, info.usable_max_m);
    hdGetIntegerv(HD_OUTPUT_DOF, &info.output_dof);
    hdGetIntegerv(HD_CALIBRATION_STYLE, &info.calibration_style);
    if (info.output_dof < 6) return;
    double *const of_torque[4] = {&info.max_torque_n_m, &info.continuous_torque_n_m, &info.max_stiffness_n_m_rad,
                                  &info.max_damping_n_m_s_rad};
    const HDenum names[4] = {HD_NOMINAL_MAX_TORQUE_FORCE, HD_NOMINAL_MAX_TORQUE_CONTINUOUS_FORCE,
                             HD_NOMINAL_MAX_TORQUE_STIFFNESS, HD_NOMINAL_MAX_TORQUE_DAMPING};
    for (int i = 0; i < 4; ++i) {
        hdGetDoublev(names[i], of_torque[i]);
        *of_torque[i] *= 1e-3; // from mN m
    }
}

/// Calibrates the current device where a call can. Of several styles the encoder reset is last: it believes that the
/// stylus is where it should be.
HDenum calibrate(const plp_hd_info &info) {
    if (hdCheckCalibration() != HD_CALIBRATION_NEEDS_UPDATE) return hdCheckCalibration();
    const int style = info.calibration_style & HD_CALIBRATION_AUTO      ? HD_CALIBRATION_AUTO
                      : info.calibration_style & HD_CALIBRATION_INKWELL ? HD_CALIBRATION_INKWELL
                                                                        : HD_CALIBRATION_ENCODER_RESET;
    hdUpdateCalibration(static_cast<HDenum>(style));
    return hdCheckCalibration();
}

/// What the device bears, through the mapping.
void bear(const plp_hd_info &info, const Mapping &mapping, double max_speed_m_s, plp_haptic_desc &to) {
    const plp_haptic_desc touch = plp_haptic_desc_default(); // for what HDAPI does not name
    const double k = mapping.force_scale(), ks = k * mapping.scale();
    const auto or_else = [](double said, double otherwise) { return said > 0.0 ? said : otherwise; };
    to.max_force_n = info.max_force_n / k;
    to.continuous_force_n = or_else(info.continuous_force_n, info.max_force_n) / k;
    to.max_stiffness_n_m = or_else(info.max_stiffness_n_m, touch.max_stiffness_n_m) / ks;
    to.max_damping_n_s_m = or_else(info.max_damping_n_s_m, 0.0) / ks;
    // HDAPI names no slew; it must never be so slow that a force stays too long.
    to.slew_n_s = std::fmax(touch.slew_n_s / k, to.max_force_n / FALL_S);

    // Angles and torques are the same on both sides.
    to.max_torque_n_m = info.max_torque_n_m;
    to.continuous_torque_n_m = or_else(info.continuous_torque_n_m, info.max_torque_n_m);
    to.max_stiffness_n_m_rad = info.max_stiffness_n_m_rad;
    to.max_damping_n_m_s_rad = info.max_damping_n_m_s_rad;
    to.slew_n_m_s = to.max_torque_n_m / FALL_S;

    to.servo_rate_hz = info.servo_rate_hz;
    to.max_speed_m_s = mapping.scale() * max_speed_m_s;
    to.flags &= ~PLP_HAPTIC_BALL;
    for (int i = 0; i < 3; ++i) {
        const double edge_m = info.reach_max_m[i] - info.reach_min_m[i];
        to.workspace_m[i] = mapping.scale() * or_else(0.5 * edge_m, touch.workspace_m[0]);
    }
}

HDCallbackCode HDCALLBACK servo_callback(void *user) {
    plp_hd *port = static_cast<plp_hd *>(user);
    // A second caller's BUSY is no reason to end; a stopped port is.
    return plp_hd_run_tick(port) == PLP_ERR_STATE ? HD_CALLBACK_DONE : HD_CALLBACK_CONTINUE;
}

/// Ends the ticks, then the force. Never waits longer than a second for a tick that hangs.
plp_status stop(plp_hd &port) {
    if (!port.is_started.exchange(false)) return PLP_OK;
    if (port.is_scheduled) hdUnschedule(port.callback);
    const bool is_out = wait_outside(port);
    int tries = 0;
    in_servo([&port, &tries] {
        hdMakeCurrentDevice(port.device);
        hdDisable(HD_FORCE_OUTPUT);
        // And a frame without force, so that no old one waits for the next start. Where this tick had its frame already,
        // the next one must do.
        take_errors(port);
        hdBeginFrame(port.device);
        const bool is_taken = take_errors(port) == HD_ILLEGAL_BEGIN;
        const double zero[3] = {0.0, 0.0, 0.0};
        if (!is_taken) {
            hdSetDoublev(HD_CURRENT_FORCE, zero);
            if (port.info.output_dof >= 6) hdSetDoublev(HD_CURRENT_GIMBAL_TORQUE, zero);
            hdEndFrame(port.device);
        }
        take_errors(port);
        return !is_taken || ++tries == 3;
    });
    if (port.is_scheduled && --scheduled_ports == 0) hdStopScheduler();
    port.is_scheduled = false;
    return is_out ? PLP_OK : fail(PLP_ERR_BUSY, "a tick has not ended for a second; the force is off");
}

/// The error of an hdInitDevice, which may name another device (one that is open already) and is not that one's fault.
std::uint32_t take_opening_error() {
    std::uint32_t found = HD_SUCCESS;
    for (int i = 0; i < 64; ++i) {
        const HDErrorInfo error = hdGetError();
        if (!HD_DEVICE_ERROR(error)) break;
        found = error.errorCode;
    }
    return found;
}

void clear(plp_hd &port) {
    port.newest.write(plp_hd_tick{});
    for (auto &n : port.fault_ticks) n.store(0);
    port.faults_ever.store(0);
    port.last_hd_error.store(HD_SUCCESS);
    port.asks_resume.store(false);
    port.has_new_tool.store(false);
    port.met_second_caller.store(false);
    port.tool.store(nullptr);
    port.servo = {};
    for (Periods *p : {&port.periods, &port.work, &port.ages}) p->clear();
}

} // namespace

std::uint32_t palpate_hd::take_errors(plp_hd &port) noexcept {
    const auto place = static_cast<std::size_t>(&port - ports);
    std::uint32_t first = kept_errors[place].exchange(HD_SUCCESS, std::memory_order_relaxed);
    // Newest first, so that the last one that comes out is the first that went in. The stack is bounded; this loop is
    // too, should other threads fill it as fast.
    for (int i = 0; i < 64; ++i) {
        const HDErrorInfo error = hdGetError();
        if (!HD_DEVICE_ERROR(error)) break;
        if (error.hHD == port.device) {
            // What stops the force is not hidden by a question without an answer.
            if (first == HD_SUCCESS || fault_of(error.errorCode) != 0) first = error.errorCode;
            continue;
        }
        for (std::size_t other = 0; other < PLP_HD_PORTS; ++other) {
            if (ports[other].is_open.load(std::memory_order_relaxed) && ports[other].device == error.hHD) {
                kept_errors[other].store(error.errorCode, std::memory_order_relaxed);
            }
        }
    }
    return first;
}

std::uint32_t palpate_hd::fault_of(std::uint32_t hd_error) noexcept {
    if (hd_error == HD_BAD_HANDLE) return PLP_HD_FAULT_DEVICE;
    switch (hd_error & 0xFF00u) {
    case 0x0200: return PLP_HD_FAULT_LIMIT;
    case 0x0300: return PLP_HD_FAULT_DEVICE;
    case 0x0400:
    case 0x0500: return PLP_HD_FAULT_FRAME;
    case 0x0600: return PLP_HD_FAULT_DEVICE;
    default: return 0; // success, and questions that this device does not answer
    }
}

plp_status plp_hd_desc_init(plp_hd_desc *desc, uint32_t desc_size) {
    if (!desc) return fail(PLP_ERR_NULL, "the desc is NULL");
    if (desc_size != sizeof *desc) return fail(PLP_ERR_STRUCT_SIZE, "the desc's size is %u, not %zu", desc_size, sizeof *desc);
    *desc = {};
    desc->struct_size = desc_size;
    desc->mapping.base.rotation[3] = 1.0;
    desc->mapping.scale = 1.0;
    desc->max_speed_m_s = 2.0;
    return PLP_OK;
}

plp_status plp_hd_open(const plp_hd_desc *desc, plp_hd **out) {
    if (!out) return fail(PLP_ERR_NULL, "the output is NULL");
    const plp_hd_desc defaults = plp_hd_desc_default();
    const plp_hd_desc &how = desc ? *desc : defaults;
    if (how.struct_size != sizeof how) return fail(PLP_ERR_STRUCT_SIZE, "the desc was not made by plp_hd_desc_init");
    if (!Mapping::is_good(how.mapping)) return fail(PLP_ERR_ARGUMENT, "the mapping is none");
    if (!(how.max_speed_m_s > 0.0) || (how.flags & ~PLP_HD_HOST_SERVO) != 0) {
        return fail(PLP_ERR_ARGUMENT, "max_speed_m_s must be above 0, and flags known");
    }

    const std::lock_guard<std::mutex> lock(host);
    plp_hd *port = nullptr;
    for (plp_hd &p : ports) {
        if (!p.is_open.load() && p.inside.load() % 2 == 0 && !port) port = &p;
    }
    if (!port) return fail(PLP_ERR_LIMIT, "%d devices are open", PLP_HD_PORTS);

    port->device = HD_INVALID_HANDLE;
    take_errors(*port); // what the others left
    const HHD device = hdInitDevice(how.device_name);
    const std::uint32_t error = take_opening_error();
    clear(*port);
    port->device = device;
    port->desc = how;
    port->desc.device_name = nullptr; // the caller's memory
    port->mapping = Mapping(how.mapping);
    port->info = {};
    if (device == HD_INVALID_HANDLE || fault_of(error) != 0) {
        const char *name = how.device_name ? how.device_name : "the default device";
        // Given back, unless it is another port's.
        const auto has_it = [device](const plp_hd &p) { return p.is_open.load() && p.device == device; };
        if (device != HD_INVALID_HANDLE && std::none_of(std::begin(ports), std::end(ports), has_it)) hdDisableDevice(device);
        return fail(PLP_ERR_DEVICE, "%s cannot be opened: %s (0x%04x)", name, hdGetErrorString(error), error);
    }
    in_servo([port] {
        hdMakeCurrentDevice(port->device);
        ask(port->info);
        calibrate(port->info);
        hdDisable(HD_FORCE_OUTPUT);
        // The device's own guard stays on behind the bridge's.
        hdEnable(HD_MAX_FORCE_CLAMPING);
        take_errors(*port);
        return true;
    });
    // Without a limit there would be no force at all; a device that names none gets the smallest that there is.
    if (!(port->info.max_force_n > 0.0)) port->info.max_force_n = 0.88;
    port->is_open.store(true);
    *out = port;
    return PLP_OK;
}

plp_status plp_hd_close(plp_hd *port) {
    if (!port) return PLP_OK;
    const std::lock_guard<std::mutex> lock(host);
    if (const plp_status bad = check(port)) return bad;
    const plp_status stopped = stop(*port);
    port->is_open.store(false);
    wait_outside(*port);
    hdDisableDevice(port->device);
    take_errors(*port);
    return stopped;
}

plp_status plp_hd_get_info(plp_hd *port, plp_hd_info *info, uint32_t info_size) {
    if (const plp_status bad = check(port)) return bad;
    return give(port->info, info, info_size);
}

plp_status plp_hd_haptic(plp_hd *port, plp_haptic_desc *haptic) {
    const std::lock_guard<std::mutex> lock(host);
    if (const plp_status bad = check(port)) return bad;
    if (!haptic) return fail(PLP_ERR_NULL, "the output is NULL");
    if (haptic->struct_size != sizeof *haptic) {
        return fail(PLP_ERR_STRUCT_SIZE, "the desc was not made by plp_haptic_desc_init");
    }
    bear(port->info, port->mapping, port->desc.max_speed_m_s, *haptic);
    return PLP_OK;
}

plp_status plp_hd_attach(plp_hd *port, plp_tool *tool) {
    const std::lock_guard<std::mutex> lock(host);
    if (const plp_status bad = check(port)) return bad;
    plp_servo_statistics unused;
    if (const plp_status bad = tool ? plp_tool_get_servo_statistics(tool, &unused, sizeof unused) : PLP_OK) {
        return fail(bad, "%s; plp_hd_haptic fills a desc for plp_tool_desc.haptic", plp_last_error());
    }
    // First none, then the new one: a tick in between must not meet the new tool with the old one's state.
    port->tool.store(nullptr);
    if (!wait_outside(*port)) return fail(PLP_ERR_BUSY, "a tick has not ended for a second; no tool is attached");
    port->has_new_tool.store(true, std::memory_order_release);
    port->tool.store(tool);
    return PLP_OK;
}

plp_status plp_hd_map(plp_hd *port, const plp_hd_mapping *mapping) {
    if (!mapping) return fail(PLP_ERR_NULL, "the mapping is NULL");
    const std::lock_guard<std::mutex> lock(host);
    if (const plp_status bad = check(port)) return bad;
    if (!Mapping::is_good(*mapping)) return fail(PLP_ERR_ARGUMENT, "the mapping is none");
    if (port->is_started.load()) return fail(PLP_ERR_STATE, "the port must be stopped");
    if (!wait_outside(*port)) return fail(PLP_ERR_BUSY, "a tick has not ended for a second");
    port->mapping = Mapping(*mapping);
    return PLP_OK;
}

plp_status plp_hd_start(plp_hd *port) {
    const std::lock_guard<std::mutex> lock(host);
    if (const plp_status bad = check(port)) return bad;
    if (port->is_started.load()) return fail(PLP_ERR_STATE, "the port is started already");
    if (!wait_outside(*port)) return fail(PLP_ERR_BUSY, "a tick has not ended for a second");
    HDenum calibration = HD_CALIBRATION_OK;
    in_servo([port, &calibration] {
        hdMakeCurrentDevice(port->device);
        calibration = calibrate(port->info);
        hdEnable(HD_FORCE_OUTPUT);
        return true;
    });
    // An uncalibrated device starts, without force, so that its user can calibrate it.
    if (const std::uint32_t error = take_errors(*port); fault_of(error) & PLP_HD_FAULT_DEVICE && calibration == HD_CALIBRATION_OK) {
        in_servo([port] {
            hdMakeCurrentDevice(port->device);
            hdDisable(HD_FORCE_OUTPUT);
            return true;
        });
        return fail(PLP_ERR_DEVICE, "the force cannot be enabled: %s (0x%04x)", hdGetErrorString(error), error);
    }

    plp_hd::Servo &s = port->servo;
    s.has_ticked = s.has_seen = false;
    s.is_led = s.is_placed; // the tool may be far from where the hand is by now
    s.lets_go = true;           // and the hand in it
    s.latched = 0;
    for (Periods *p : {&port->periods, &port->work, &port->ages}) p->clear();
    port->started_s.store(port->now_s());
    port->is_started.store(true);
    if (port->desc.flags & PLP_HD_HOST_SERVO) return PLP_OK;

    port->callback = hdScheduleAsynchronous(servo_callback, port, HD_MAX_SCHEDULER_PRIORITY);
    port->is_scheduled = true;
    if (scheduled_ports++ == 0) hdStartScheduler();
    const std::uint32_t error = take_errors(*port);
    if (error == HD_SCHEDULER_FULL || error == HD_TIMER_ERROR) {
        stop(*port);
        return fail(PLP_ERR_DEVICE, "the servo cannot be started: %s (0x%04x)", hdGetErrorString(error), error);
    }
    return PLP_OK;
}

plp_status plp_hd_stop(plp_hd *port) {
    const std::lock_guard<std::mutex> lock(host);
    if (const plp_status bad = check(port)) return bad;
    return stop(*port);
}

plp_status plp_hd_calibrate(plp_hd *port) {
    const std::lock_guard<std::mutex> lock(host);
    if (const plp_status bad = check(port)) return bad;
    HDenum calibration = HD_CALIBRATION_OK;
    in_servo([port, &calibration] {
        hdMakeCurrentDevice(port->device);
        calibration = calibrate(port->info);
        return true;
    });
    if (calibration == HD_CALIBRATION_OK) return PLP_OK;
    return fail(PLP_ERR_STATE, "the device needs a hand: put its stylus into the inkwell, or follow its manual");
}

plp_status plp_hd_resume(plp_hd *port) {
    if (const plp_status bad = check(port)) return bad;
    port->asks_resume.store(true);
    return PLP_OK;
}

plp_status plp_hd_get_state(plp_hd *port, plp_hd_state *state, uint32_t state_size) {
    if (const plp_status bad = check(port)) return bad;
    plp_hd_state now{};
    if (!port->newest.read(&now.last)) return fail(PLP_ERR_BUSY, "the servo writes faster than this thread can read");
    now.is_started = port->is_started.load() ? 1 : 0;
    const double since_s = now.last.tick > 0 ? now.last.time_s : port->started_s.load();
    now.idle_s = now.is_started || now.last.tick > 0 ? port->now_s() - since_s : 0.0;
    now.faults = now.last.faults;
    now.faults_ever = port->faults_ever.load();
    for (int i = 0; i < PLP_HD_FAULT_COUNT; ++i) now.fault_ticks[i] = port->fault_ticks[i].load();
    if (now.is_started && now.idle_s > 0.050) now.faults |= PLP_HD_FAULT_SERVO;
    now.last_hd_error = port->last_hd_error.load();
    return give(now, state, state_size);
}

plp_status plp_hd_get_statistics(plp_hd *port, plp_hd_statistics *statistics, uint32_t statistics_size) {
    if (const plp_status bad = check(port)) return bad;
    const Periods &p = port->periods, &w = port->work, &a = port->ages;
    plp_hd_statistics now{};
    now.ticks = w.count();
    now.p50_s = p.quantile_s(0.5);
    now.p99_s = p.quantile_s(0.99);
    now.p999_s = p.quantile_s(0.999);
    now.max_s = p.max_s();
    now.over_1_1_ms = p.over_late();
    now.over_2_ms = p.over_missed();
    now.longest_run_over_1_1_ms = p.longest_run();
    now.work_p50_s = w.quantile_s(0.5);
    now.work_p99_s = w.quantile_s(0.99);
    now.work_max_s = w.max_s();
    now.age_p50_s = a.quantile_s(0.5);
    now.age_p99_s = a.quantile_s(0.99);
    now.age_max_s = a.max_s();
    for (std::size_t i = 0; i < Periods::BUCKETS; ++i) now.periods[i] = p.bucket(i);
    return give(now, statistics, statistics_size);
}

plp_status plp_hd_reset_statistics(plp_hd *port) {
    if (const plp_status bad = check(port)) return bad;
    for (Periods *p : {&port->periods, &port->work, &port->ages}) p->clear();
    return PLP_OK;
}

const char *plp_hd_fault_name(uint32_t fault) {
    switch (fault) {
    case PLP_HD_FAULT_NOT_FINITE: return "not finite";
    case PLP_HD_FAULT_JUMP: return "jump";
    case PLP_HD_FAULT_DEVICE: return "device";
    case PLP_HD_FAULT_LIMIT: return "limit";
    case PLP_HD_FAULT_CALIBRATION: return "calibration";
    case PLP_HD_FAULT_TISSUE: return "tissue";
    case PLP_HD_FAULT_STALE: return "stale";
    case PLP_HD_FAULT_BUSY: return "busy";
    case PLP_HD_FAULT_FRAME: return "frame";
    case PLP_HD_FAULT_SERVO: return "servo";
    default: return "?";
    }
}

const char *plp_hd_last_error(void) { return last_error; }
