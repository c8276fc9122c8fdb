// The simulated device and hand move as mass, spring, damper, friction and encoders say, and the same every time.
#include <cstdio>
#include <cstring>
#include <vector>

#include "scene.h"

namespace {

/// A device alone in virtual time, with what a test changes.
HHD open(void (*change)(hd_emulator_device *) = nullptr) {
    hd_emulator_reset();
    hd_emulator_use_virtual_time(1);
    const HHD device = hdInitDevice(HD_DEFAULT_DEVICE);
    hd_emulator_device desc;
    hd_emulator_device_init(&desc);
    if (change) change(&desc);
    hd_emulator_set_device(device, &desc);
    hdEnable(HD_FORCE_OUTPUT);
    return device;
}

hd_emulator_truth truth_of(HHD device) {
    hd_emulator_truth truth;
    hd_emulator_get_truth(device, &truth);
    return truth;
}

void hold_at(HHD device, double x_m) {
    hd_emulator_motion motion;
    hd_emulator_motion_init(&motion, HD_EMULATOR_HOLD);
    motion.start_m[0] = x_m;
    hd_emulator_set_motion(device, &motion);
}

/// A constant force along x in every tick.
double push_n;
HHD pushed;
HDCallbackCode HDCALLBACK push(void *) {
    const double force[3] = {push_n, 0.0, 0.0};
    hdBeginFrame(pushed);
    hdSetDoublev(HD_CURRENT_FORCE, force);
    hdEndFrame(pushed);
    return HD_CALLBACK_CONTINUE;
}

void a_hand_swings_to_its_target_at_its_natural_frequency() {
    const HHD device = open([](hd_emulator_device *d) {
        d->coulomb_n = 0.0;
        d->hand_damping_n_s_m = 2.0;
    });
    hold_at(device, 0.010);
    hdStartScheduler();
    // m x'' + (b + c) x' + k x = 0 from rest: whole swings lie 2 pi / w apart, and each is exp(-d T) of the one before.
    const double mass = 0.045 + 0.15, damping = 2.0 + 0.02, stiffness = 300.0;
    const double rate = damping / (2.0 * mass), w = std::sqrt(stiffness / mass - rate * rate);
    double crossings[3] = {}, before = -0.010, lowest = 0.0;
    int found = 0;
    for (int i = 1; found < 3; ++i) {
        hd_emulator_advance(1e-3);
        const double off = truth_of(device).position_m[0] - 0.010;
        if (before < 0.0 && off >= 0.0) crossings[found++] = 1e-3 * (i - off / (off - before));
        if (found == 1 && off < lowest) lowest = off;
        before = off;
    }
    const double period_s = 2.0 * std::acos(-1.0) / w;
    NEAR(crossings[1] - crossings[0], period_s, 0.005 * period_s);
    NEAR(crossings[2] - crossings[1], period_s, 0.005 * period_s);
    NEAR(lowest, -0.010 * std::exp(-rate * period_s), 0.02 * 0.010);
}

void a_constant_force_moves_the_hand_by_force_over_stiffness() {
    pushed = open([](hd_emulator_device *d) { d->coulomb_n = 0.0; });
    hold_at(pushed, 0.0);
    push_n = 0.9;
    hdScheduleAsynchronous(push, nullptr, HD_MAX_SCHEDULER_PRIORITY);
    hdStartScheduler();
    hd_emulator_advance(2.0);
    NEAR(truth_of(pushed).position_m[0], 0.9 / 300.0, 1e-6);
    NEAR(truth_of(pushed).force_n[0], 0.9, 1e-12);
}

void an_unheld_device_accelerates_by_force_over_its_own_mass() {
    pushed = open([](hd_emulator_device *d) { d->coulomb_n = d->viscous_n_s_m = 0.0; });
    hd_emulator_motion let_go;
    hd_emulator_motion_init(&let_go, HD_EMULATOR_LET_GO);
    hd_emulator_set_motion(pushed, &let_go);
    push_n = 0.045;
    hdScheduleAsynchronous(push, nullptr, HD_MAX_SCHEDULER_PRIORITY);
    hdStartScheduler();
    hd_emulator_advance(0.101); // the first tick pushes from 1 ms on
    NEAR(truth_of(pushed).velocity_m_s[0], 0.1, 1e-6);
}

void friction_holds_what_it_can_and_stops_the_rest() {
    const HHD device = open();
    hdStartScheduler();
    hold_at(device, 0.26 / 300.0 * 0.95); // the spring pulls with less than friction holds
    hd_emulator_advance(1.0);
    CHECK(truth_of(device).position_m[0] == 0.0);
    hold_at(device, 0.010);
    hd_emulator_advance(2.0);
    const hd_emulator_truth rest = truth_of(device);
    CHECK(rest.velocity_m_s[0] == 0.0);
    CHECK(std::fabs(rest.position_m[0] - 0.010) <= 0.26 / 300.0 && rest.position_m[0] > 0.009);
}

void encoders_show_steps_and_velocities_made_of_them() {
    const HHD device = open([](hd_emulator_device *d) { d->coulomb_n = 0.0; });
    hd_emulator_set_hand(
        device,
        [](void *, double time_s, hd_emulator_target *target) {
            target->position_m[0] = 0.05 * time_s;
            target->velocity_m_s[0] = 0.05;
        },
        nullptr);
    hdStartScheduler();
    hd_emulator_advance(0.5);
    const double step_mm = 0.055;
    for (int i = 0; i < 200; ++i) {
        double position[3], velocity[3];
        hd_emulator_advance(1e-3);
        hdBeginFrame(device);
        hdGetDoublev(HD_CURRENT_POSITION, position);
        hdGetDoublev(HD_CURRENT_VELOCITY, velocity);
        hdEndFrame(device);
        const double steps = position[0] / step_mm;
        NEAR(steps, std::round(steps), 1e-9);
        NEAR(position[0], 1e3 * truth_of(device).position_m[0], 0.5 * step_mm + 1e-9);
        // Ten ticks apart, so that a step of the encoder is 5.5 mm/s.
        NEAR(velocity[0], 50.0, 5.6);
    }
}

void scripted_hands_go_where_they_are_told() {
    const HHD device = open();
    hdStartScheduler();
    hd_emulator_motion motion;
    hd_emulator_motion_init(&motion, HD_EMULATOR_DRAG);
    motion.travel_m = 0.02;
    motion.speed_m_s = 0.1;
    motion.hold_s = 0.1;
    hd_emulator_set_motion(device, &motion);
    // In: pi/2 of 0.02 / 0.1 s; then the hold, the drag of as long, and back.
    const double in_s = 0.3141592653589793;
    double most = 0.0;
    std::vector<double> path;
    for (int i = 0; i < 2000; ++i) {
        const hd_emulator_truth before = truth_of(device);
        hd_emulator_advance(1e-3);
        const hd_emulator_truth now = truth_of(device);
        double way[3];
        for (int k = 0; k < 3; ++k) way[k] = now.target_m[k] - before.target_m[k];
        most = std::fmax(most, length(way) / 1e-3);
        const double t = hd_emulator_time_s();
        if (t > in_s && t < in_s + 0.1) NEAR(now.target_m[2], -0.02, 1e-12);
        if (t > 2.0 * in_s + 0.1 && t < 2.0 * in_s + 0.15) NEAR(now.target_m[0], 0.02, 1e-12);
    }
    NEAR(most, 0.1, 0.001);

    // A wandering hand stays in its box, and the same seed wanders the same way.
    hd_emulator_motion_init(&motion, HD_EMULATOR_RANDOM);
    for (int pass = 0; pass < 2; ++pass) {
        const HHD again = open();
        hd_emulator_set_motion(again, &motion);
        hdStartScheduler();
        for (int i = 0; i < 500; ++i) {
            hd_emulator_advance(2e-3);
            const hd_emulator_truth now = truth_of(again);
            for (int k = 0; k < 3; ++k) {
                CHECK(std::fabs(now.target_m[k]) <= 0.02);
                if (pass == 0) {
                    path.push_back(now.position_m[k]);
                } else {
                    CHECK(path[static_cast<std::size_t>(3 * i + k)] == now.position_m[k]);
                }
            }
        }
    }
}

void a_recorded_hand_is_read_from_a_file() {
    const HHD device = open();
    const auto file = [device](const char *text) {
        std::FILE *out = std::fopen("hand.csv", "w");
        std::fputs(text, out);
        std::fclose(out);
        return hd_emulator_load_motion(device, "hand.csv");
    };
    CHECK(file("time_s,x_m,y_m,z_m\n0,0,0,0\n1,0.01,0,-0.02\n") == 1);
    hdStartScheduler();
    hd_emulator_advance(0.5);
    NEAR(truth_of(device).target_m[0], 0.005, 1e-9);
    NEAR(truth_of(device).target_m[2], -0.010, 1e-9);
    hd_emulator_advance(1.0);
    NEAR(truth_of(device).target_m[2], -0.020, 1e-12);
    CHECK(file("0,0,0,0\n1,nonsense\n") == 0);
    CHECK(file("1,0,0,0\n0,0,0,0\n") == 0);
    CHECK(file("") == 0);
    CHECK(hd_emulator_load_motion(device, "no such file") == 0);
}

} // namespace

int main() {
    a_hand_swings_to_its_target_at_its_natural_frequency();
    a_constant_force_moves_the_hand_by_force_over_stiffness();
    an_unheld_device_accelerates_by_force_over_its_own_mass();
    friction_holds_what_it_can_and_stops_the_rest();
    encoders_show_steps_and_velocities_made_of_them();
    scripted_hands_go_where_they_are_told();
    a_recorded_hand_is_read_from_a_file();
    hd_emulator_reset();
    std::puts("emulator hand: ok");
}
