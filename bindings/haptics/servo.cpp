// The tick: one frame of HDAPI. No lock, no allocation, no exception, no call that waits.
#include <chrono>

#include "port.h"

using namespace palpate_hd;

namespace {

constexpr double MM = 1e3, MNM = 1e3;
/// How fast a tool is led to where the device is after a fault, in device metres: a hand's pace.
constexpr double LEAD_M_S = 0.5;
/// Shorter moves are no jumps, however short the time: encoders step, and ticks crowd after a late one.
constexpr double SMALL_MOVE_M = 0.005;
/// Longer gaps of the servo do not make longer moves plausible.
constexpr double LONG_GAP_S = 0.05;
/// After a longer gap the tool is led: a hand goes far in it, and the tool would strike there in one step.
constexpr double SHORT_GAP_S = 0.01;
/// Ticks that follow sooner have the stamp of the one before: a step of an encoder in no time would be taken for speed.
constexpr double SHORT_TICK_S = 1e-4;
/// While one of these lasts, where the device says it is means nothing.
constexpr std::uint32_t LOST = PLP_HD_FAULT_NOT_FINITE | PLP_HD_FAULT_DEVICE | PLP_HD_FAULT_CALIBRATION;

/// What the device says, SI, device frame.
struct Reading {
    Vec3 position_m{}, velocity_m_s{}, angular_rad_s{}, gimbal_rad{};
    Quat rotation{0, 0, 0, 1};
    int buttons = 0;
    bool is_good = false;
};

Reading read(const plp_hd &port) noexcept {
    Reading r;
    double m[16] = {}, velocity[3] = {}, angular[3] = {}, gimbal[3] = {};
    hdGetDoublev(HD_CURRENT_TRANSFORM, m);
    hdGetDoublev(HD_CURRENT_VELOCITY, velocity);
    hdGetDoublev(HD_CURRENT_ANGULAR_VELOCITY, angular);
    hdGetIntegerv(HD_CURRENT_BUTTONS, &r.buttons);
    if (port.info.output_dof >= 6) hdGetDoublev(HD_CURRENT_GIMBAL_ANGLES, gimbal);
    r.position_m = (1.0 / MM) * vec(m + 12);
    r.velocity_m_s = (1.0 / MM) * vec(velocity);
    r.angular_rad_s = vec(angular);
    r.gimbal_rad = vec(gimbal);
    // Not every device turns this into numbers, and no force hangs on it.
    if (!is_finite(r.angular_rad_s)) r.angular_rad_s = {};
    r.is_good = is_finite(r.position_m) && is_finite(r.velocity_m_s) && is_finite(r.gimbal_rad) &&
                rotation_of(m, &r.rotation);
    return r;
}

/// Whether the device moved farther than it can since it was seen last; it is seen here now.
bool is_jump(plp_hd &port, const Reading &r, double now_s) noexcept {
    plp_hd::Servo &s = port.servo;
    const double passed_s = now_s - s.seen_s < LONG_GAP_S ? now_s - s.seen_s : LONG_GAP_S;
    const double reach_m = port.desc.max_speed_m_s * passed_s;
    const bool jumped = s.has_seen && length(r.position_m - s.seen_m) > (reach_m > SMALL_MOVE_M ? reach_m : SMALL_MOVE_M);
    s.seen_m = r.position_m;
    s.seen_s = now_s;
    s.has_seen = true;
    return jumped;
}

/// Moves the tool to the device: at once, or at a hand's pace after a fault, so that it does not strike through tissue.
void move_tool(plp_hd &port, const Reading &r, double dt_s) noexcept {
    plp_hd::Servo &s = port.servo;
    const Vec3 wanted = port.mapping.place(r.position_m);
    store(port.mapping.rotation(r.rotation), s.sent.pose.rotation);
    store(port.mapping.angular(r.angular_rad_s), s.sent.angular_rad_s);
    if (s.is_placed && s.is_led) {
        const Vec3 here = vec(s.sent.pose.position_m);
        const Vec3 step = at_most(wanted - here, LEAD_M_S * port.mapping.scale() * dt_s);
        store(here + step, s.sent.pose.position_m);
        store(dt_s > 0.0 ? (1.0 / dt_s) * step : Vec3{}, s.sent.linear_m_s);
        s.is_led = length(wanted - (here + step)) > 1e-9;
        return;
    }
    store(wanted, s.sent.pose.position_m);
    store(port.mapping.velocity(r.velocity_m_s), s.sent.linear_m_s);
    s.is_placed = true;
    s.is_led = false;
}

/// Whether another thread was inside the tool, which then answers what it answered last: a tick that was missed, and no more.
bool is_busy(plp_status status, const plp_servo &felt) noexcept {
    return status == PLP_ERR_BUSY && (felt.flags & PLP_SERVO_STOPPED) == 0;
}

/// What the tool's answer says is wrong.
std::uint32_t faults_of(plp_status status, const plp_servo &felt) noexcept {
    std::uint32_t faults = 0;
    const bool is_answer = status == PLP_OK || is_busy(status, felt);
    if (!is_answer || felt.flags & (PLP_SERVO_STOPPED | PLP_SERVO_NOT_FINITE)) faults |= PLP_HD_FAULT_TISSUE;
    if (felt.flags & PLP_SERVO_TOO_FAST) faults |= PLP_HD_FAULT_JUMP;
    // Before the first step nothing has grown old.
    if (felt.flags & PLP_SERVO_DECAYING && felt.age_s >= 0.0) faults |= PLP_HD_FAULT_STALE;
    return faults;
}

/// Tells the tool where the device is and asks for its force. `is_held` is whether there may be one.
void exchange(plp_hd &port, plp_tool *tool, bool is_held, plp_hd_tick &t) noexcept {
    plp_hd::Servo &s = port.servo;
    if (!(t.time_s - s.stamp_s < SHORT_TICK_S && t.time_s >= s.stamp_s)) s.stamp_s = t.time_s;
    const plp_haptic_state state{s.sent, s.stamp_s, is_held ? 0u : PLP_HAPTIC_RELEASED, t.buttons};
    plp_servo felt{};
    t.status = plp_tool_exchange(tool, &state, &felt);
    store(vec(felt.force_n), t.force_n);
    store(vec(felt.torque_n_m), t.torque_n_m);
    t.tool = felt.tool;
    t.age_s = felt.age_s;
    t.latency_s = felt.latency_s;
    t.sequence = felt.sequence;
    t.servo_flags = felt.flags;
    t.faults |= faults_of(t.status, felt);
    if (felt.age_s >= 0.0) port.ages.add(felt.age_s);
    // A tool that did not answer has not seen this tick: its force must not come back where it left off, nor go on where it should have ended.
    if (t.status < 0 && (!is_held || !is_busy(t.status, felt))) s.lets_go = true;
}

void count(plp_hd &port, const plp_hd_tick &t) noexcept {
    for (int i = 0; i < PLP_HD_FAULT_COUNT; ++i) {
        // BUSY is counted by those who were refused.
        if ((t.faults >> i & 1u) && (1u << i) != PLP_HD_FAULT_BUSY) {
            port.fault_ticks[i].fetch_add(1, std::memory_order_relaxed);
        }
    }
    port.faults_ever.fetch_or(t.faults, std::memory_order_relaxed);
    if (t.hd_error != HD_SUCCESS) port.last_hd_error.store(t.hd_error, std::memory_order_relaxed);
}

/// What is wrong before the tissue is asked.
std::uint32_t look_for_faults(plp_hd &port, const Reading &r, double now_s, plp_hd_tick &t) noexcept {
    std::uint32_t faults = port.servo.latched;
    if (!r.is_good) {
        faults |= PLP_HD_FAULT_NOT_FINITE;
    } else if (is_jump(port, r, now_s)) {
        faults |= PLP_HD_FAULT_JUMP;
    }
    if (hdCheckCalibration() != HD_CALIBRATION_OK) faults |= PLP_HD_FAULT_CALIBRATION;
    if (port.met_second_caller.exchange(false, std::memory_order_relaxed)) faults |= PLP_HD_FAULT_BUSY;
    t.hd_error = take_errors(port);
    return faults | fault_of(t.hd_error);
}

void run(plp_hd &port) noexcept {
    plp_hd::Servo &s = port.servo;
    plp_hd_tick t{};
    t.tick = ++s.tick;
    t.time_s = port.now_s();
    t.period_s = s.has_ticked ? t.time_s - s.last_s : 0.0;
    if (s.has_ticked) port.periods.add(t.period_s);
    s.last_s = t.time_s;
    s.has_ticked = true;
    // After a gap the led tool goes on as if it had been short.
    const double dt_s = t.period_s < SHORT_GAP_S ? t.period_s : SHORT_GAP_S;
    if (t.period_s > SHORT_GAP_S) s.is_led = true;

    if (port.asks_resume.exchange(false, std::memory_order_relaxed)) s.latched = 0;
    if (port.has_new_tool.exchange(false, std::memory_order_acquire)) {
        s.is_placed = false;
        s.lets_go = true; // one that was attached before engages anew as well
    }

    hdBeginFrame(port.device);
    const Reading r = read(port);
    t.faults = look_for_faults(port, r, t.time_s, t);
    t.buttons = static_cast<std::uint32_t>(r.buttons);
    store(r.position_m, t.device_position_m);

    // The tool stays where it is while nobody knows where the device is, and in the very tick of a jump.
    if (t.faults & (LOST | PLP_HD_FAULT_JUMP | PLP_HD_FAULT_FRAME)) s.is_led = true;
    if (t.faults & (LOST | PLP_HD_FAULT_JUMP)) {
        store(Vec3{}, s.sent.linear_m_s);
        store(Vec3{}, s.sent.angular_rad_s);
    } else {
        move_tool(port, r, dt_s);
    }

    // Whatever is wrong on this side of the tool is a dead-man switch that was let go: the tool's own chain then takes the
    // force away, and brings it back when it may.
    const bool is_held = t.faults == 0 && !s.is_led && !s.lets_go;
    s.lets_go = false;
    t.status = PLP_NOTHING;
    t.age_s = -1.0;
    t.motion = t.tool = s.sent;
    plp_tool *const tool = port.tool.load();
    if (tool && s.is_placed) exchange(port, tool, is_held, t);

    // The tool keeps the limits that it was made with; this holds for one that was made for another device or scale.
    store(at_most(port.mapping.force(vec(t.force_n)), port.info.max_force_n), t.device_force_n);
    hdSetDoublev(HD_CURRENT_FORCE, t.device_force_n);
    if (port.info.output_dof >= 6) {
        const Vec3 torque = at_most(port.mapping.torque(vec(t.torque_n_m)), port.info.max_torque_n_m);
        if (r.is_good) store(gimbal_torque(r.rotation, r.gimbal_rad, torque), t.gimbal_torque_n_m);
        double gimbal_mn_m[3];
        store(MNM * vec(t.gimbal_torque_n_m), gimbal_mn_m);
        hdSetDoublev(HD_CURRENT_GIMBAL_TORQUE, gimbal_mn_m);
    }
    hdEndFrame(port.device);

    // What the end of the frame brought up stops the force of the next tick.
    const std::uint32_t late_error = take_errors(port);
    if (t.hd_error == HD_SUCCESS) t.hd_error = late_error;
    t.faults |= fault_of(late_error);
    s.latched |= t.faults & PLP_HD_FAULT_DEVICE;
    if (const std::uint32_t late = fault_of(late_error)) {
        s.lets_go = true;
        if (late & (LOST | PLP_HD_FAULT_FRAME)) s.is_led = true;
    }

    count(port, t);
    port.newest.write(t);
    if (port.desc.on_tick) port.desc.on_tick(port.desc.on_tick_user, &t);
    port.work.add(port.now_s() - t.time_s);
}

} // namespace

double plp_hd::now_s() const noexcept {
    if (desc.clock) return desc.clock(desc.clock_user);
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

plp_status plp_hd_run_tick(plp_hd *port) {
    if (!port) return PLP_ERR_NULL;
    if (port < ports || port >= ports + PLP_HD_PORTS || !port->is_open.load()) return PLP_ERR_INVALID_HANDLE;
    if (port->busy.test_and_set(std::memory_order_acquire)) {
        port->met_second_caller.store(true, std::memory_order_relaxed);
        port->fault_ticks[7].fetch_add(1, std::memory_order_relaxed);
        port->faults_ever.fetch_or(PLP_HD_FAULT_BUSY, std::memory_order_relaxed);
        return PLP_ERR_BUSY;
    }
    // Sequentially consistent, as are is_started and tool in host functions: who changes one of these and then finds the
    // port outside a tick knows that every later tick sees the change.
    port->inside.fetch_add(1);
    plp_status status = PLP_ERR_STATE;
    if (port->is_started.load()) {
        run(*port);
        status = PLP_OK;
    }
    port->inside.fetch_add(1);
    port->busy.clear(std::memory_order_release);
    return status;
}
