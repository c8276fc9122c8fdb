// Counts times in equal buckets: one thread adds, any thread reads.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

namespace palpate_hd {

/// Times from 0 to 5 ms in buckets of 10 us, and one for all that is longer. Equal buckets, because the question is
/// how far a period of 1 ms strays.
class Periods {
public:
    static constexpr std::size_t BUCKETS = 501;
    static constexpr double BUCKET_S = 10e-6;
    static constexpr double LATE_S = 1.1e-3, MISSED_S = 2e-3;

    /// By the one thread that adds. There is no other writer, so that a load and a store do for an increment.
    void add(double seconds) noexcept {
        const double bucket = seconds / BUCKET_S;
        const std::size_t index = bucket > 0.0 ? (bucket < BUCKETS - 1 ? static_cast<std::size_t>(bucket) : BUCKETS - 1) : 0;
        increment(counts_[index]);
        increment(count_);
        if (seconds > max_s_.load(std::memory_order_relaxed)) max_s_.store(seconds, std::memory_order_relaxed);
        if (seconds > MISSED_S) increment(over_missed_);
        if (seconds > LATE_S) {
            increment(over_late_);
            if (++run_ > longest_run_.load(std::memory_order_relaxed)) longest_run_.store(run_, std::memory_order_relaxed);
        } else {
            run_ = 0;
        }
    }

    std::uint64_t count() const noexcept { return count_.load(std::memory_order_relaxed); }
    double max_s() const noexcept { return max_s_.load(std::memory_order_relaxed); }
    std::uint64_t over_late() const noexcept { return over_late_.load(std::memory_order_relaxed); }
    std::uint64_t over_missed() const noexcept { return over_missed_.load(std::memory_order_relaxed); }
    std::uint64_t longest_run() const noexcept { return longest_run_.load(std::memory_order_relaxed); }
    std::uint64_t bucket(std::size_t i) const noexcept { return counts_[i].load(std::memory_order_relaxed); }

    /// The time that this part of all did not exceed: the end of its bucket, and never more than the longest.
    double quantile_s(double part) const noexcept {
        std::uint64_t all = 0, seen = 0;
        for (const auto &c : counts_) all += c.load(std::memory_order_relaxed);
        if (all == 0) return 0.0;
        const double wanted = part * static_cast<double>(all);
        for (std::size_t i = 0; i + 1 < BUCKETS; ++i) {
            seen += bucket(i);
            if (static_cast<double>(seen) >= wanted) {
                const double end_s = static_cast<double>(i + 1) * BUCKET_S;
                return end_s < max_s() ? end_s : max_s();
            }
        }
        return max_s();
    }

    /// From none on; while the other thread adds, a few times may be lost or kept.
    void clear() noexcept {
        for (auto &c : counts_) c.store(0, std::memory_order_relaxed);
        for (auto *c : {&count_, &over_late_, &over_missed_, &longest_run_}) c->store(0, std::memory_order_relaxed);
        max_s_.store(0.0, std::memory_order_relaxed);
    }

private:
    static void increment(std::atomic<std::uint64_t> &c) noexcept {
        c.store(c.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
    }

    std::array<std::atomic<std::uint64_t>, BUCKETS> counts_{};
    std::atomic<std::uint64_t> count_{0}, over_late_{0}, over_missed_{0}, longest_run_{0};
    std::atomic<double> max_s_{0.0};
    std::uint64_t run_ = 0; // of the adding thread
};

} // namespace palpate_hd
