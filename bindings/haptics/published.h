// The newest value of something, from one writer that never waits to any number of readers.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

namespace palpate_hd {

/// A value in two places, written in turns: a reader is disturbed by the second write after the one that it reads, and by no
/// writer that was held up inside. The words are atomic, so that nothing is undefined for a reader who meets a writer: it reads a
/// torn value, sees the number changed, and reads again.
template <typename T> class Published {
    static_assert(std::is_trivially_copyable<T>::value, "it is copied word by word");

public:
    /// By the one writer.
    void write(const T &value) noexcept {
        Words words{};
        std::memcpy(words.data(), &value, sizeof value);
        const std::uint32_t next = number_.load(std::memory_order_relaxed) + 1;
        // Release: a reader that meets a word of this value in the place of an old one finds the number changed as well.
        for (std::size_t i = 0; i < WORDS; ++i) places_[next % 2][i].store(words[i], std::memory_order_release);
        // Release: who reads the number has all words.
        number_.store(next, std::memory_order_release);
    }

    /// False where two values were written during each of many looks, which takes a reader that is held up every time.
    bool read(T *value) const noexcept {
        Words words;
        for (int tries = 0; tries < 1000; ++tries) {
            // Acquire: the words are at least as new as the number.
            const std::uint32_t number = number_.load(std::memory_order_acquire);
            // Acquire: the number is looked at again after all words.
            for (std::size_t i = 0; i < WORDS; ++i) words[i] = places_[number % 2][i].load(std::memory_order_acquire);
            if (number_.load(std::memory_order_relaxed) == number) {
                std::memcpy(value, words.data(), sizeof *value);
                return true;
            }
        }
        return false;
    }

private:
    static constexpr std::size_t WORDS = (sizeof(T) + 7) / 8;
    using Words = std::array<std::uint64_t, WORDS>;

    std::array<std::atomic<std::uint64_t>, WORDS> places_[2]{};
    /// Counts values; the newest is in the place of its parity.
    std::atomic<std::uint32_t> number_{0};
};

} // namespace palpate_hd
