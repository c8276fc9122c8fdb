// The simulated device in the simulated hand: one mass, SI units.
#pragma once

#include <array>

#include "hd_emulator.h"

namespace emulator {

using Vec3 = std::array<double, 3>;

/// Step of the integration. A stiff hand on a light device has 52 rad/s, so that 20 kHz is far more than enough.
constexpr double BODY_STEP_S = 50e-6;

/// Device and hand move as one: the hand's mass grips the handle, and its spring and damper lead to where the script
/// wants to be.
struct Body {
    Vec3 position_m{};
    Vec3 velocity_m_s{};

    /// Moves over dt under the motors' force. Without a hand only the device's own mass and friction are left.
    void step(const hd_emulator_device &device, const hd_emulator_target *hand, const Vec3 &force_n, double dt);
};

/// What the driver makes of the encoders: positions in steps, and velocities from positions some time apart.
class Encoders {
public:
    /// Takes a sample; times must grow.
    void sample(const hd_emulator_device &device, const Vec3 &true_position_m, double time_s);
    /// Forgets the past, so that the next velocity is zero.
    void clear() { count_ = 0; }
    const Vec3 &position_m() const { return position_m_; }
    const Vec3 &velocity_m_s() const { return velocity_m_s_; }

private:
    static constexpr unsigned KEPT = 64;
    struct Sample {
        double time_s;
        Vec3 position_m;
    };
    std::array<Sample, KEPT> samples_{};
    unsigned newest_ = 0, count_ = 0;
    Vec3 position_m_{}, velocity_m_s_{};
};

} // namespace emulator
