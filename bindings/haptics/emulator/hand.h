// Where the hand wants to be: ready-made motions, recorded ones, and functions of the user.
#pragma once

#include <vector>

#include "hd_emulator.h"

namespace emulator {

class Hand {
public:
    Hand() { hd_emulator_motion_init(&motion_, HD_EMULATOR_HOLD); }

    void follow(const hd_emulator_motion &motion);
    void follow(hd_emulator_hand_fn function, void *user);
    /// From a file of time_s,x_m,y_m,z_m; false leaves the hand as it was.
    bool follow_file(const char *path);

    /// Whether there is a hand at all.
    bool holds() const { return function_ || !recorded_.empty() || motion_.kind != HD_EMULATOR_LET_GO; }
    /// Where it wants to be at a time.
    void target(double time_s, hd_emulator_target *target) const;

private:
    struct Row {
        double time_s;
        double position_m[3];
    };
    void recorded(double time_s, hd_emulator_target *target) const;
    void scripted(double time_s, hd_emulator_target *target) const;

    hd_emulator_motion motion_;
    hd_emulator_hand_fn function_ = nullptr;
    void *user_ = nullptr;
    std::vector<Row> recorded_;
};

} // namespace emulator
