// Every tick of the servo, kept in memory that is there before the servo runs, and written to a file afterwards.
#pragma once

#include <atomic>
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
        const double force_2 = f[0] * f[0] + f[1] * f[1] + f[2] * f[2];
        if (force_2 > r.peak_2_) r.peak_2_ = force_2;
        r.count_.store(n + 1, std::memory_order_release);
    }

    /// After the servo has ended: the largest force squared, in N^2.
    double peak_force_2() const { return peak_2_; }

    /// After the servo has ended.
    bool write(const std::string &path) const {
        std::FILE *file = std::fopen(path.c_str(), "w");
        if (!file) return false;
        std::fputs("time_s,x_m,y_m,z_m,qx,qy,qz,qw,force_x_n,force_y_n,force_z_n,device_x_n,device_y_n,device_z_n,"
                   "age_s,gain,faults,buttons,sequence\n",
                   file);
        const std::uint64_t end = count_.load(std::memory_order_acquire);
        const std::uint64_t begin = end > rows_.size() ? end - rows_.size() : 0;
        const double start_s = end > begin ? rows_[begin % rows_.size()].time_s : 0.0;
        for (std::uint64_t i = begin; i < end; ++i) {
            const plp_hd_tick &t = rows_[i % rows_.size()];
            const double *p = t.motion.pose.position_m, *q = t.motion.pose.rotation;
            const double *f = t.force_n, *d = t.device_force_n;
            std::fprintf(file, "%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.5f,%.5f,%.5f,%.5f,%.5f,%.5f,%.6f,%.4f,%u,%u,%llu\n",
                         t.time_s - start_s, p[0], p[1], p[2], q[0], q[1], q[2], q[3], f[0], f[1], f[2], d[0], d[1],
                         d[2], t.age_s, t.gain, t.faults, t.buttons, static_cast<unsigned long long>(t.sequence));
        }
        return std::fclose(file) == 0;
    }

private:
    std::vector<plp_hd_tick> rows_;
    std::atomic<std::uint64_t> count_{0};
    double peak_2_ = 0.0;
};
