#include "body.h"

#include <cmath>

namespace emulator {

void Body::step(const hd_emulator_device &device, const hd_emulator_target *hand, const Vec3 &force_n, double dt) {
    const double mass = device.device_mass_kg + (hand ? device.hand_mass_kg : 0.0);
    const double spring = hand ? device.hand_stiffness_n_m : 0.0;
    const double damper = hand ? device.hand_damping_n_s_m : 0.0;

    // The dampers are taken at the new velocity, so that no damping makes the step unstable.
    const double resistance = mass + dt * (damper + device.viscous_n_s_m);
    for (int i = 0; i < 3; ++i) {
        double push = force_n[i];
        if (hand) push += spring * (hand->position_m[i] - position_m[i]) + damper * hand->velocity_m_s[i];
        velocity_m_s[i] = (mass * velocity_m_s[i] + dt * push) / resistance;
    }

    // Coulomb friction takes what speed it can, and holds a body that it can stop: sticking needs no threshold.
    const double speed = std::hypot(velocity_m_s[0], velocity_m_s[1], velocity_m_s[2]);
    const double braked = dt * device.coulomb_n / resistance;
    const double kept = speed > braked ? 1.0 - braked / speed : 0.0;
    for (int i = 0; i < 3; ++i) {
        velocity_m_s[i] *= kept;
        position_m[i] += dt * velocity_m_s[i];
    }
}

void Encoders::sample(const hd_emulator_device &device, const Vec3 &true_position_m, double time_s) {
    const double step = device.encoder_step_m;
    for (int i = 0; i < 3; ++i) {
        position_m_[i] = step > 0.0 ? step * std::round(true_position_m[i] / step) : true_position_m[i];
    }
    newest_ = (newest_ + 1) % KEPT;
    samples_[newest_] = {time_s, position_m_};
    if (count_ < KEPT) ++count_;

    // The oldest sample that is still within the window; at least the one before.
    unsigned back = 1;
    while (back + 1 < count_ &&
           time_s - samples_[(newest_ + KEPT - back - 1) % KEPT].time_s <= device.velocity_window_s + 1e-9) {
        ++back;
    }
    velocity_m_s_ = {};
    if (count_ < 2) return;
    const Sample &old = samples_[(newest_ + KEPT - back) % KEPT];
    for (int i = 0; i < 3; ++i) velocity_m_s_[i] = (position_m_[i] - old.position_m[i]) / (time_s - old.time_s);
}

} // namespace emulator
