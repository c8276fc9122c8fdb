//! Numbers too small to matter are taken as zero while a step runs: where a wave fades out they would cost a hundred times as much as others.

/// While it lives, this thread reads and writes subnormal numbers as zero; then its floating-point mode is as before.
#[derive(Debug)]
pub struct FlushToZero {
    #[cfg(target_arch = "x86_64")]
    before: u32,
}

/// Bits "flush to zero" and "denormals are zero" of MXCSR.
#[cfg(target_arch = "x86_64")]
const FLUSH: u32 = 1 << 15 | 1 << 6;

impl FlushToZero {
    /// Changes this thread's mode.
    pub fn new() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            let before = get();
            set(before | FLUSH);
            Self { before }
        }
        #[cfg(not(target_arch = "x86_64"))]
        Self {}
    }
}

impl Default for FlushToZero {
    fn default() -> Self {
        Self::new()
    }
}

impl Drop for FlushToZero {
    fn drop(&mut self) {
        #[cfg(target_arch = "x86_64")]
        set(get() & !FLUSH | self.before & FLUSH);
    }
}

#[cfg(target_arch = "x86_64")]
fn get() -> u32 {
    let mut mode = 0_u32;
    // SAFETY: stores a control register that every x86-64 processor has.
    unsafe { std::arch::asm!("stmxcsr [{}]", in(reg) &raw mut mode, options(nostack, preserves_flags)) };
    mode
}

/// The language assumes the default mode; this changes nothing of it but how subnormal numbers are treated, around calls that are not
/// inlined here, and no result below depends on when exactly that begins.
#[cfg(target_arch = "x86_64")]
fn set(mode: u32) {
    // SAFETY: only the two bits differ from what the register held.
    unsafe { std::arch::asm!("ldmxcsr [{}]", in(reg) &raw const mode, options(nostack, readonly)) };
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use std::hint::black_box;

    use super::*;

    #[test]
    fn tiny_numbers_are_zero_inside_and_themselves_again_outside() {
        let half = || black_box(f32::MIN_POSITIVE) * black_box(0.5);
        assert!(half() > 0.0);
        {
            let _mode = FlushToZero::new();
            assert_eq!(half(), 0.0);
        }
        assert!(half() > 0.0);
    }
}
