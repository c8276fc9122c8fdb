#include "hand.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>

namespace emulator {

namespace {

constexpr double TURN = 6.283185307179586;

/// A number from 0 to 1 that depends on the seed and the place alone (splitmix64): the same on every platform.
double draw(std::uint64_t seed, std::uint64_t place) {
    std::uint64_t x = seed + 0x9E3779B97F4A7C15ULL * (place + 1);
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ULL;
    x = (x ^ (x >> 27)) * 0x94D049BB133111EBULL;
    return static_cast<double>((x ^ (x >> 31)) >> 11) * 0x1.0p-53;
}

/// A way of `length` with rounded starts and ends, and its speed, at a time since its beginning. The largest speed is
/// `speed`.
void travel(double length, double speed, double time_s, double *way, double *rate) {
    // A raised cosine moves at pi/2 of its mean speed in the middle.
    const double duration = length > 0.0 && speed > 0.0 ? 0.25 * TURN * length / speed : 0.0;
    *rate = 0.0;
    if (time_s <= 0.0) {
        *way = 0.0;
    } else if (time_s >= duration) {
        *way = length;
    } else {
        const double phase = 0.5 * TURN * time_s / duration;
        *way = 0.5 * length * (1.0 - std::cos(phase));
        *rate = 0.5 * length * std::sin(phase) * 0.5 * TURN / duration;
    }
}

double duration_of(double length, double speed) {
    return length > 0.0 && speed > 0.0 ? 0.25 * TURN * length / speed : 0.0;
}

} // namespace

void Hand::follow(const hd_emulator_motion &motion) {
    motion_ = motion;
    const double length = std::hypot(motion.direction[0], motion.direction[1], motion.direction[2]);
    for (double &d : motion_.direction) d = length > 0.0 ? d / length : 0.0;
    function_ = nullptr;
    recorded_.clear();
}

void Hand::follow(hd_emulator_hand_fn function, void *user) {
    function_ = function;
    user_ = user;
    recorded_.clear();
}

bool Hand::follow_file(const char *path) {
    std::FILE *file = std::fopen(path, "r");
    if (!file) return false;
    std::vector<Row> rows;
    char line[256];
    bool good = true, first = true;
    while (good && std::fgets(line, sizeof line, file)) {
        Row row{};
        if (std::sscanf(line, "%lf ,%lf ,%lf ,%lf", &row.time_s, &row.position_m[0], &row.position_m[1],
                        &row.position_m[2]) == 4) {
            good = (rows.empty() || row.time_s > rows.back().time_s) && std::isfinite(row.time_s) &&
                   std::all_of(row.position_m, row.position_m + 3, [](double x) { return std::isfinite(x); });
            rows.push_back(row);
        } else {
            good = first || line[0] == '\n' || line[0] == '\r' || line[0] == '#'; // a first line may be a heading
        }
        first = false;
    }
    std::fclose(file);
    if (!good || rows.empty()) return false;
    recorded_ = std::move(rows);
    function_ = nullptr;
    return true;
}

void Hand::target(double time_s, hd_emulator_target *target) const {
    *target = {};
    if (function_) {
        function_(user_, time_s, target);
    } else if (!recorded_.empty()) {
        recorded(time_s, target);
    } else {
        scripted(time_s, target);
    }
}

void Hand::recorded(double time_s, hd_emulator_target *target) const {
    const auto after = std::upper_bound(recorded_.begin(), recorded_.end(), time_s,
                                        [](double time, const Row &row) { return time < row.time_s; });
    if (after == recorded_.begin() || after == recorded_.end()) {
        const Row &end = after == recorded_.begin() ? recorded_.front() : recorded_.back();
        std::copy(end.position_m, end.position_m + 3, target->position_m);
        return;
    }
    const Row &before = *(after - 1);
    const double span = after->time_s - before.time_s, part = (time_s - before.time_s) / span;
    for (int i = 0; i < 3; ++i) {
        const double way = after->position_m[i] - before.position_m[i];
        target->position_m[i] = before.position_m[i] + part * way;
        target->velocity_m_s[i] = way / span;
    }
}

void Hand::scripted(double time_s, hd_emulator_target *target) const {
    const hd_emulator_motion &m = motion_;
    std::copy(m.start_m, m.start_m + 3, target->position_m);
    if (m.kind == HD_EMULATOR_HOLD || m.kind == HD_EMULATOR_LET_GO) return;

    if (m.kind == HD_EMULATOR_RANDOM) {
        // Three sines an axis, whose amplitudes sum to amplitude_m: within bounds, smooth, and without a period.
        for (int i = 0; i < 3; ++i) {
            for (int k = 0; k < 3; ++k) {
                const std::uint64_t place = static_cast<std::uint64_t>(6 * i + 2 * k);
                const double rate = TURN * m.frequency_hz * (0.3 + 0.7 * draw(m.seed, place));
                const double phase = TURN * draw(m.seed, place + 1);
                target->position_m[i] += m.amplitude_m / 3.0 * std::sin(rate * time_s + phase);
                target->velocity_m_s[i] += m.amplitude_m / 3.0 * rate * std::cos(rate * time_s + phase);
            }
        }
        return;
    }

    // In, hold, across (DRAG), back; again and again.
    const double in_s = duration_of(m.travel_m, m.speed_m_s);
    const double across_m = m.kind == HD_EMULATOR_DRAG ? std::hypot(m.drag_m[0], m.drag_m[1], m.drag_m[2]) : 0.0;
    const double across_s = duration_of(across_m, m.speed_m_s);
    const double cycle_s = 2.0 * (in_s + m.hold_s + across_s);
    const double t = cycle_s > 0.0 && time_s > m.wait_s ? std::fmod(time_s - m.wait_s, cycle_s) : 0.0;

    double depth = 0.0, depth_rate = 0.0, out = 0.0, out_rate = 0.0;
    travel(m.travel_m, m.speed_m_s, t, &depth, &depth_rate);
    travel(m.travel_m, m.speed_m_s, t - (in_s + m.hold_s + across_s), &out, &out_rate);
    depth -= out;
    depth_rate -= out_rate;
    double side = 0.0, side_rate = 0.0, home = 0.0, home_rate = 0.0;
    if (across_m > 0.0) {
        travel(across_m, m.speed_m_s, t - (in_s + m.hold_s), &side, &side_rate);
        travel(across_m, m.speed_m_s, t - (2.0 * in_s + m.hold_s + across_s), &home, &home_rate);
    }
    if (m.kind == HD_EMULATOR_TREMOR) {
        depth += m.amplitude_m * std::sin(TURN * m.frequency_hz * time_s);
        depth_rate += m.amplitude_m * TURN * m.frequency_hz * std::cos(TURN * m.frequency_hz * time_s);
    }
    for (int i = 0; i < 3; ++i) {
        const double across = across_m > 0.0 ? m.drag_m[i] / across_m : 0.0;
        target->position_m[i] += depth * m.direction[i] + (side - home) * across;
        target->velocity_m_s[i] += depth_rate * m.direction[i] + (side_rate - home_rate) * across;
    }
}

} // namespace emulator
