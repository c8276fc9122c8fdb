// The bridge puts the device's workspace into the world, and brings force and torque back so that work is kept.
#include <cstring>
#include <initializer_list>

#include "mapping.h"
#include "scene.h"

using palpate_hd::Quat;
using palpate_hd::Vec3;

namespace {

/// A mapping that turns the device's "away from the user" (-z) to the world's "down into the block", as a desk device that
/// presses a lying patient: device y is world y, device z is world z, but all turned about z by a quarter.
plp_hd_mapping quarter_turn(double scale, uint32_t rule) {
    plp_hd_mapping m{};
    m.base = plp_pose_at(0.02, 0.02, 0.05);
    m.base.rotation[2] = m.base.rotation[3] = std::sqrt(0.5);
    m.scale = scale;
    m.force_rule = rule;
    return m;
}

void places_velocities_and_rotations_follow_the_mapping() {
    const palpate_hd::Mapping m(quarter_turn(2.0, PLP_HD_FORCE_BY_WORK));
    const Vec3 at = m.place({0.010, 0.020, 0.030}), v = m.velocity({0.1, 0.0, 0.0}), w = m.angular({0.1, 0.0, 0.0});
    NEAR(at.x, 0.02 - 0.040, 1e-15); // x goes to y, y to -x
    NEAR(at.y, 0.02 + 0.020, 1e-15);
    NEAR(at.z, 0.05 + 0.060, 1e-15);
    NEAR(v.y, 0.2, 1e-15);
    NEAR(w.y, 0.1, 1e-15); // angles do not scale
    // A stylus turned by 0.4 about its own z in a frame that is turned by a quarter about z.
    const Quat q = m.rotation({0.0, 0.0, std::sin(0.2), std::cos(0.2)});
    NEAR(2.0 * std::atan2(q.z, q.w), 0.4 + std::acos(0.0), 1e-14);
}

void scaled_forces_do_the_same_work_or_are_the_same_newtons() {
    const Vec3 force{0.3, -0.2, 0.7}, v{0.05, 0.02, -0.04}, torque{0.01, 0.02, 0.03}, w{1.0, -2.0, 0.5};
    const double scales[3] = {0.5, 1.0, 3.0};
    for (const double scale : scales) {
        const palpate_hd::Mapping by_work(quarter_turn(scale, PLP_HD_FORCE_BY_WORK));
        const palpate_hd::Mapping as_felt(quarter_turn(scale, PLP_HD_FORCE_AS_FELT));
        NEAR(dot(by_work.force(force), v), dot(force, by_work.velocity(v)), 1e-15);
        NEAR(dot(by_work.torque(torque), w), dot(torque, by_work.angular(w)), 1e-15);
        NEAR(length(as_felt.force(force)), length(force), 1e-15);
    }
}

void a_transform_becomes_the_quaternion_that_turns_the_same() {
    // All four ways of finding the largest part.
    const double angles[4] = {0.3, 3.0, 3.1, 2.9};
    const Vec3 axes[4] = {{0.6, 0.0, 0.8}, {1.0, 0.0, 0.1}, {0.1, 1.0, 0.0}, {0.0, 0.1, 1.0}};
    for (int i = 0; i < 4; ++i) {
        const Vec3 axis = (1.0 / length(axes[i])) * axes[i];
        const double s = std::sin(0.5 * angles[i]);
        const Quat q{s * axis.x, s * axis.y, s * axis.z, std::cos(0.5 * angles[i])};
        double m[16] = {};
        store(rotate(q, {1, 0, 0}), m);
        store(rotate(q, {0, 1, 0}), m + 4);
        store(rotate(q, {0, 0, 1}), m + 8);
        Quat found{};
        CHECK(palpate_hd::rotation_of(m, &found));
        const double same = found.x * q.x + found.y * q.y + found.z * q.z + found.w * q.w;
        NEAR(std::fabs(same), 1.0, 1e-12);
        m[5] = std::nan("");
        CHECK(!palpate_hd::rotation_of(m, &found));
    }
    const double zeros[16] = {}, mirror[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1};
    Quat found{};
    CHECK(!palpate_hd::rotation_of(zeros, &found) && !palpate_hd::rotation_of(mirror, &found));
}

/// The emulator's stylus with these gimbal angles.
Quat stylus(const double *a) {
    const Quat yaw{0, std::sin(0.5 * a[0]), 0, std::cos(0.5 * a[0])};
    const Quat pitch{std::sin(0.5 * a[1]), 0, 0, std::cos(0.5 * a[1])};
    const Quat roll{0, 0, std::sin(0.5 * a[2]), std::cos(0.5 * a[2])};
    return yaw * pitch * roll;
}

void gimbal_torques_do_the_work_of_the_torque() {
    const double angles[3] = {0.4, -0.7, 1.1}, h = 1e-6;
    const Vec3 torque{0.011, -0.023, 0.017};
    const Vec3 motors = gimbal_torque(stylus(angles), {angles[0], angles[1], angles[2]}, torque);
    const double of_motor[3] = {motors.x, motors.y, motors.z};
    for (int i = 0; i < 3; ++i) {
        // The small turn that one gimbal angle makes, from the quaternions of both sides of it.
        double more[3] = {angles[0], angles[1], angles[2]};
        more[i] += h;
        const Quat turn = stylus(more) * inverse(stylus(angles));
        const Vec3 rate{2.0 * turn.x / h, 2.0 * turn.y / h, 2.0 * turn.z / h};
        NEAR(of_motor[i], dot(torque, rate), 1e-7);
    }
}

void the_device_feels_the_tissue_in_its_own_axes() {
    plp_hd_desc desc = press_desc();
    desc.mapping = quarter_turn(1.0, PLP_HD_FORCE_BY_WORK);
    Scene scene(desc);
    scene.run(2.0);
    scene.expect_force();
    const plp_hd_state s = scene.state();
    CHECK(s.last.force_n[2] > 0.2); // jelly pushes the ball up
    CHECK(s.last.tool.pose.position_m[2] > s.last.motion.pose.position_m[2]); // and the ball hangs back from the hand
    NEAR(s.last.device_force_n[2], s.last.force_n[2], 1e-12);
    NEAR(s.last.device_force_n[0], s.last.force_n[1], 1e-12);
    NEAR(s.last.device_force_n[1], -s.last.force_n[0], 1e-12);
    NEAR(s.last.motion.pose.position_m[2], 0.05 + s.last.device_position_m[2], 1e-12);
    CHECK(s.last.age_s >= 0.0 && s.last.age_s <= 1.5e-3 && s.last.status == PLP_OK && s.last.sequence > 1000);
    NEAR(s.last.latency_s, 1e-3, 1e-9); // a step between two ticks
    // And it is the force that holds the hand back: the spring's pull, less what friction takes.
    hd_emulator_truth truth;
    hd_emulator_get_truth(device(), &truth);
    const double pull_n = 300.0 * (truth.position_m[2] - truth.target_m[2]);
    NEAR(pull_n, s.last.device_force_n[2], 0.26 + 0.01);
}

void a_scaled_tool_is_deeper_and_its_force_is_scaled() {
    plp_hd_desc desc = press_desc();
    desc.mapping.scale = 0.5; // 6 mm of tool for 12 mm of hand
    Scene scene(desc);
    scene.run(2.0);
    const plp_hd_state s = scene.state();
    NEAR(s.last.motion.pose.position_m[2], 0.05 + 0.5 * s.last.device_position_m[2], 1e-12);
    CHECK(s.last.force_n[2] > 0.05);
    NEAR(s.last.device_force_n[2], 0.5 * s.last.force_n[2], 1e-12);
}

void what_a_device_bears_is_told_in_the_units_of_the_world() {
    const double scales[3] = {0.5, 1.0, 3.0};
    for (const double s : scales) {
        for (const uint32_t rule : {PLP_HD_FORCE_BY_WORK, PLP_HD_FORCE_AS_FELT}) {
            const double k = rule == PLP_HD_FORCE_BY_WORK ? s : 1.0;
            hd_emulator_reset();
            plp_hd *port = nullptr;
            plp_hd_desc desc = press_desc();
            desc.mapping = quarter_turn(s, rule);
            HD_ANSWERS(PLP_OK, plp_hd_open(&desc, &port));
            plp_haptic_desc world = plp_haptic_desc_default();
            world.window_s = 3.0; // is the host's to say
            HD_ANSWERS(PLP_OK, plp_hd_haptic(port, &world));
            NEAR(k * world.max_force_n, 3.3, 1e-12);
            NEAR(k * world.continuous_force_n, 0.88, 1e-12);
            NEAR(k * world.slew_n_s, 1000.0, 1e-9);
            // A device metre is s metres of the world, and a newton of the world k of the device.
            NEAR(k * s * world.max_stiffness_n_m, 500.0, 1e-9);
            NEAR(k * s * world.max_damping_n_s_m, 5.0, 1e-9);
            NEAR(world.max_speed_m_s, 2.0 * s, 1e-12);
            NEAR(world.workspace_m[0], 0.210 * s, 1e-12);
            CHECK(world.servo_rate_hz == 1000.0 && world.max_torque_n_m == 0.0 && world.window_s == 3.0);
            CHECK((world.flags & PLP_HAPTIC_BALL) == 0 && (world.flags & PLP_HAPTIC_PASSIVE) != 0);
            const plp_haptic_desc once = world;
            HD_ANSWERS(PLP_OK, plp_hd_haptic(port, &world));
            CHECK(std::memcmp(&once, &world, sizeof world) == 0);

            // And such a device is one that a tool can have.
            plp_model *model = coarse_block();
            plp_sim *sim = simulation(model);
            ANSWERS(PLP_OK, plp_tool_destroy(ball_of(sim, &world)));
            ANSWERS(PLP_OK, plp_sim_destroy(sim));
            ANSWERS(PLP_OK, plp_model_destroy(model));
            HD_ANSWERS(PLP_OK, plp_hd_close(port));
        }
    }
}

void the_force_never_exceeds_the_device_whatever_the_scale() {
    for (const uint32_t rule : {PLP_HD_FORCE_BY_WORK, PLP_HD_FORCE_AS_FELT}) {
        plp_hd_desc desc = press_desc();
        static double highest_n, fastest_n, last_n;
        highest_n = fastest_n = last_n = 0.0;
        desc.mapping.force_rule = rule;
        desc.mapping.scale = 1.5; // hard pressed
        desc.on_tick = [](void *, const plp_hd_tick *t) {
            const double now_n = length(t->device_force_n);
            CHECK(std::isfinite(now_n));
            highest_n = std::fmax(highest_n, now_n);
            fastest_n = std::fmax(fastest_n, now_n - last_n);
            last_n = now_n;
        };
        Scene scene(desc);
        scene.run(1.5);
        CHECK(highest_n <= 3.3 + 1e-12 && highest_n > 0.3 && fastest_n <= 1.0 + 1e-9);
    }
}

void a_tool_that_no_device_can_hold_is_refused() {
    Scene scene;
    plp_tool *bare = ball(scene.sim);
    HD_ANSWERS(PLP_ERR_STATE, plp_hd_attach(scene.port, bare));
    CHECK(std::strstr(plp_hd_last_error(), "plp_hd_haptic"));
    ANSWERS(PLP_OK, plp_tool_destroy(bare));
    HD_ANSWERS(PLP_ERR_NULL, plp_hd_haptic(scene.port, nullptr));
    plp_haptic_desc unfilled{};
    HD_ANSWERS(PLP_ERR_STRUCT_SIZE, plp_hd_haptic(scene.port, &unfilled));
}

void a_six_axis_device_gets_its_torque_in_millinewton_metres() {
    Scene scene;
    plp_hd_info info;
    HD_ANSWERS(PLP_OK, plp_hd_get_info(scene.port, &info, sizeof info));
    CHECK(info.output_dof == 3 && info.max_force_n == 3.3 && info.continuous_force_n == 0.88);
    NEAR(info.max_stiffness_n_m, 500.0, 1e-9);
    NEAR(info.max_damping_n_s_m, 5.0, 1e-9);
    NEAR(info.usable_max_m[0], 0.08, 1e-15);

    // The same device with a gimbal that drives. The ball hangs beside the tool's origin, so that pressing turns it.
    HD_ANSWERS(PLP_OK, plp_hd_close(scene.port));
    hd_emulator_device strong;
    hd_emulator_device_init(&strong);
    strong.output_dof = 6;
    hd_emulator_set_next_device(&strong);
    const plp_hd_desc desc = press_desc();
    HD_ANSWERS(PLP_OK, plp_hd_open(&desc, &scene.port));
    HD_ANSWERS(PLP_OK, plp_hd_get_info(scene.port, &info, sizeof info));
    CHECK(info.output_dof == 6);
    NEAR(info.max_torque_n_m, 0.515, 1e-12);
    NEAR(info.continuous_torque_n_m, 0.188, 1e-12);
    plp_haptic_desc haptic = plp_haptic_desc_default();
    HD_ANSWERS(PLP_OK, plp_hd_haptic(scene.port, &haptic));
    CHECK(haptic.max_torque_n_m == info.max_torque_n_m && haptic.max_stiffness_n_m_rad == info.max_stiffness_n_m_rad);
    plp_tool_part part = plp_sphere(0.008);
    part.pose.position_m[0] = 0.01;
    plp_tool_desc how = plp_tool_desc_default();
    plp_tool *lever = nullptr;
    how.parts = &part;
    how.part_count = 1;
    how.haptic = &haptic;
    ANSWERS(PLP_OK, plp_tool_create(scene.sim, &how, &lever));
    HD_ANSWERS(PLP_OK, plp_hd_attach(scene.port, lever));
    HD_ANSWERS(PLP_OK, plp_hd_start(scene.port));
    hd_emulator_set_hand(
        device(),
        [](void *, double time_s, hd_emulator_target *target) {
            const double pressed_s = std::fmax(time_s - 0.7, 0.0);
            target->position_m[2] = pressed_s < 0.5 ? -0.024 * pressed_s : -0.012;
            target->angles_rad[2] = 0.3;
        },
        nullptr);
    scene.run(2.2);
    const plp_hd_state s = scene.state();
    CHECK(s.faults == 0 && (s.last.servo_flags & HELD_BACK) == 0 && s.last.force_n[2] > 0.1);
    // The stylus is turned about the press alone: pitch and yaw share the torque by that angle.
    hd_emulator_truth truth;
    hd_emulator_get_truth(device(), &truth);
    CHECK(std::fabs(s.last.torque_n_m[1]) > 5e-4);
    NEAR(truth.torque_n_m[0], s.last.torque_n_m[1], 1e-12);
    NEAR(truth.torque_n_m[1], s.last.torque_n_m[0], 1e-12);
    NEAR(truth.torque_n_m[2], s.last.torque_n_m[2], 1e-12);
    ANSWERS(PLP_OK, plp_tool_destroy(scene.tool));
    HD_ANSWERS(PLP_OK, plp_hd_attach(scene.port, nullptr));
    scene.tool = lever;
}

void settings_that_are_none_are_refused() {
    hd_emulator_reset();
    plp_hd *port = nullptr;
    plp_hd_desc desc = plp_hd_desc_default();
    HD_ANSWERS(PLP_ERR_NULL, plp_hd_open(&desc, nullptr));
    desc.mapping.scale = 0.0;
    HD_ANSWERS(PLP_ERR_ARGUMENT, plp_hd_open(&desc, &port));
    desc = plp_hd_desc_default();
    desc.mapping.base.rotation[3] = 0.0;
    HD_ANSWERS(PLP_ERR_ARGUMENT, plp_hd_open(&desc, &port));
    desc = plp_hd_desc_default();
    desc.struct_size = 1;
    HD_ANSWERS(PLP_ERR_STRUCT_SIZE, plp_hd_open(&desc, &port));
    desc = plp_hd_desc_default();
    desc.device_name = "no such device";
    HD_ANSWERS(PLP_ERR_DEVICE, plp_hd_open(&desc, &port));
    CHECK(std::strstr(plp_hd_last_error(), "no such device"));
    HD_ANSWERS(PLP_ERR_NULL, plp_hd_start(nullptr));
    HD_ANSWERS(PLP_OK, plp_hd_close(nullptr));
    HD_ANSWERS(PLP_OK, plp_hd_open(nullptr, &port));
    plp_hd *second = nullptr;
    desc = plp_hd_desc_default();
    desc.device_name = "Default Device";
    HD_ANSWERS(PLP_ERR_DEVICE, plp_hd_open(&desc, &second));
    plp_hd_state state;
    HD_ANSWERS(PLP_ERR_STRUCT_SIZE, plp_hd_get_state(port, &state, 4));
    HD_ANSWERS(PLP_OK, plp_hd_close(port));
    HD_ANSWERS(PLP_ERR_INVALID_HANDLE, plp_hd_close(port));
    CHECK(plp_hd_run_tick(port) == PLP_ERR_INVALID_HANDLE && plp_hd_run_tick(nullptr) == PLP_ERR_NULL);
}

} // namespace

int main() {
    places_velocities_and_rotations_follow_the_mapping();
    scaled_forces_do_the_same_work_or_are_the_same_newtons();
    a_transform_becomes_the_quaternion_that_turns_the_same();
    gimbal_torques_do_the_work_of_the_torque();
    the_device_feels_the_tissue_in_its_own_axes();
    a_scaled_tool_is_deeper_and_its_force_is_scaled();
    what_a_device_bears_is_told_in_the_units_of_the_world();
    the_force_never_exceeds_the_device_whatever_the_scale();
    a_tool_that_no_device_can_hold_is_refused();
    a_six_axis_device_gets_its_torque_in_millinewton_metres();
    settings_that_are_none_are_refused();
    hd_emulator_reset();
    std::puts("bridge mapping: ok");
}
