// Every tick of the servo, kept in memory that is there before the servo runs, and written to a file afterwards.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

#include "palpate_hdapi.h"

class Record {
public:
    /// Room for the last so many ticks: older ones are overwritten, because a servo cannot wait for a disk.
    explicit Record(std::size_t ticks) : rows_(ticks) {}

    /// On the servo thread.
    static void on_tick(void *self, const plp_hd_tick *tick) noexcept {
        Record &r = *static_cast<Record *>(self);
        const std::uint64_t n = r.count_.load(std::memory_order_relaxed);
        r.rows_[n % r.rows_.size()] = *tick;
        const double *f = tick->device_force_n;
        const double force_n = std::sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
        if (force_n > r.peak_n_) r.peak_n_ = force_n;
        // Written so that a NaN is none.
        if (!(force_n <= r.max_force_n * (1.0 + 1e-9))) ++r.invalid_;
        if (n > 0 && tick->sequence != r.sequence_) ++r.fresh_;
        r.sequence_ = tick->sequence;
        r.count_.store(n + 1, std::memory_order_release);
    }

    /// The device's largest force, set before the servo runs.
    double max_force_n = 0.0;

    // All below after the servo has ended.

    double peak_n() const { return peak_n_; }
    /// Ticks whose force was not finite or above the device's largest.
    std::uint64_t invalid() const { return invalid_; }
    /// Ticks that saw a step which none before had seen.
    std::uint64_t fresh() const { return fresh_; }

    /// Times from a pose to the first tick that had a force computed with it, one for each step, in ascending order.
    std::vector<double> latencies_s() const {
        std::vector<double> found;
        std::uint64_t last = 0;
        for (std::uint64_t i = begin(); i < end(); ++i) {
            const plp_hd_tick &t = rows_[i % rows_.size()];
            // The first step may have been made with a pose of another time.
            if (t.sequence != last && last > 0 && t.latency_s > 0.0) found.push_back(t.latency_s);
            last = t.sequence;
        }
        std::sort(found.begin(), found.end());
        return found;
    }

    bool write(const std::string &path) const {
        std::FILE *file = std::fopen(path.c_str(), "w");
        if (!file) return false;
        std::fputs("time_s,x_m,y_m,z_m,qx,qy,qz,qw,tool_x_m,tool_y_m,tool_z_m,force_x_n,force_y_n,force_z_n,"
                   "device_x_m,device_y_m,device_z_m,device_x_n,device_y_n,device_z_n,age_s,latency_s,servo_flags,faults,"
                   "buttons,sequence\n",
                   file);
        const double start_s = end() > begin() ? rows_[begin() % rows_.size()].time_s : 0.0;
        for (std::uint64_t i = begin(); i < end(); ++i) {
            const plp_hd_tick &t = rows_[i % rows_.size()];
            const double *p = t.motion.pose.position_m, *q = t.motion.pose.rotation, *w = t.tool.pose.position_m;
            const double *f = t.force_n, *x = t.device_position_m, *d = t.device_force_n;
            std::fprintf(file, "%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.5f,%.5f,%.5f,", t.time_s - start_s,
                         p[0], p[1], p[2], q[0], q[1], q[2], q[3], w[0], w[1], w[2], f[0], f[1], f[2]);
            std::fprintf(file, "%.6f,%.6f,%.6f,%.5f,%.5f,%.5f,%.6f,%.6f,%u,%u,%u,%llu\n", x[0], x[1], x[2], d[0], d[1], d[2],
                         t.age_s, t.latency_s, t.servo_flags, t.faults, t.buttons,
                         static_cast<unsigned long long>(t.sequence));
        }
        return std::fclose(file) == 0;
    }

private:
    std::uint64_t end() const { return count_.load(std::memory_order_acquire); }
    std::uint64_t begin() const { return end() > rows_.size() ? end() - rows_.size() : 0; }

    std::vector<plp_hd_tick> rows_;
    std::atomic<std::uint64_t> count_{0};
    double peak_n_ = 0.0;
    std::uint64_t invalid_ = 0, fresh_ = 0, sequence_ = 0;
};
