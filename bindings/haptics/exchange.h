// The one place where the servo talks to the tissue.
#pragma once

#include <cstdint>

#include "mapping.h"

namespace palpate_hd {

struct ToolInput {
    double time_s;
    plp_motion motion;
    uint32_t buttons;
};

struct ToolOutput {
    double force_n[3];
    double torque_n_m[3];
    double age_s;
    uint64_t sequence;
    plp_status status;
    bool is_stale;
};

/// Tells the tissue where the tool is and asks what it feels. Anything but PLP_OK comes with zero force; a force that
/// grows old is held, then fades: a simulation that stalls must not push for ever.
class Exchange {
public:
    /// Held for 10 ms or four times the simulation's own period, then down to zero within 25 ms.
    static constexpr double HOLD_S = 0.010, FADE_S = 0.025;

    void forget() noexcept { *this = Exchange(); }

    ToolOutput operator()(plp_tool *tool, const ToolInput &in) noexcept {
        ToolOutput out{};
        plp_force felt{};
        out.status = plp_tool_set_pose(tool, &in.motion);
        const plp_status got = plp_tool_get_force(tool, &felt);
        if (out.status == PLP_OK) out.status = got;

        if (!is_known_ || felt.sequence != sequence_) {
            // How long the simulation takes from step to step, as it has been lately.
            if (is_known_) period_s_ += 0.1 * (in.time_s - changed_s_ - period_s_);
            sequence_ = felt.sequence;
            changed_s_ = in.time_s;
            is_known_ = true;
        }
        out.sequence = felt.sequence;
        out.age_s = in.time_s - changed_s_;

        double hold_s = 4.0 * period_s_ < 0.075 ? 4.0 * period_s_ : 0.075;
        if (hold_s < HOLD_S) hold_s = HOLD_S;
        const double left = 1.0 - (out.age_s - hold_s) / FADE_S;
        const double kept = left > 1.0 ? 1.0 : left > 0.0 ? left : 0.0;
        out.is_stale = kept == 0.0;
        const Vec3 force = vec(felt.force_n), torque = vec(felt.torque_n_m);
        if (out.status != PLP_OK || felt.sequence == 0 || !is_finite(force) || !is_finite(torque)) return out;
        store(kept * force, out.force_n);
        store(kept * torque, out.torque_n_m);
        return out;
    }

private:
    bool is_known_ = false;
    uint64_t sequence_ = 0;
    double changed_s_ = 0.0, period_s_ = 0.0;
};

} // namespace palpate_hd
