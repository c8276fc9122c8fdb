// The newest value of something, from one writer that never waits to any number of readers.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

namespace palpate_hd {

/// A value behind a sequence number that is odd while it is written. The words are atomic, so that a reader who meets a
/// writer reads a torn value, sees the number changed, and reads again; nothing is undefined.
template <typename T> class Published {
    static_assert(std::is_trivially_copyable<T>::value, "it is copied word by word");

public:
    /// By the one writer.
    void write(const T &value) noexcept {
        std::array<std::uint64_t, WORDS> words{};
        std::memcpy(words.data(), &value, sizeof value);
        const std::uint32_t number = number_.load(std::memory_order_relaxed);
        number_.store(number + 1, std::memory_order_relaxed);
        // No word may be seen before the odd number: a reader of one would not know that it is new.
        std::atomic_thread_fence(std::memory_order_release);
        for (std::size_t i = 0; i < WORDS; ++i) words_[i].store(words[i], std::memory_order_relaxed);
        // The even number comes after all words: who reads it has them.
        number_.store(number + 2, std::memory_order_release);
    }

    /// False where a writer got in between each of many times, which takes a reader that is held up every time.
    bool read(T *value) const noexcept {
        std::array<std::uint64_t, WORDS> words;
        for (int tries = 0; tries < 1000; ++tries) {
            const std::uint32_t before = number_.load(std::memory_order_acquire);
            for (std::size_t i = 0; i < WORDS; ++i) words[i] = words_[i].load(std::memory_order_relaxed);
            // The words are read before the number is looked at again.
            std::atomic_thread_fence(std::memory_order_acquire);
            if (before % 2 == 0 && number_.load(std::memory_order_relaxed) == before) {
                std::memcpy(value, words.data(), sizeof *value);
                return true;
            }
        }
        return false;
    }

private:
    static constexpr std::size_t WORDS = (sizeof(T) + 7) / 8;
    std::atomic<std::uint32_t> number_{0};
    std::array<std::atomic<std::uint64_t>, WORDS> words_{};
};

} // namespace palpate_hd
