//! Eight numbers at a time: one row of a brick. AVX2 with FMA where the processor has it, plain Rust elsewhere.
//!
//! Everything here is `inline(always)`, so that it becomes part of the kernel's body, whose `target_feature` decides the
//! instructions. Square roots and divisions are the IEEE ones: results differ between the two routes only by the fused
//! multiply-add, and not at all between processors that share a route.

use crate::math::Num;

/// The scalar of a backend: `f32` or `f64`.
pub trait Real: Num + Default + PartialOrd + Send + Sync + std::fmt::Debug + 'static {
    /// What rounding leaves of 1.
    const EPSILON: f64;

    /// Exact widening.
    fn to_f64(self) -> f64;
}

impl Real for f32 {
    const EPSILON: f64 = f32::EPSILON as f64;

    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
}

impl Real for f64 {
    const EPSILON: f64 = f64::EPSILON;

    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
}

/// Eight numbers in memory: one row of a brick, aligned for a vector register.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(32))]
pub struct Octet<R>(pub [R; 8]);

/// Eight numbers in registers.
pub trait Lanes: Num {
    /// The scalar.
    type Real: Real;

    /// Eight numbers from any address.
    ///
    /// # Safety
    /// `from` is valid for reading eight numbers.
    unsafe fn load(from: *const Self::Real) -> Self;

    /// Eight numbers to any address.
    ///
    /// # Safety
    /// `to` is valid for writing eight numbers.
    unsafe fn store(self, to: *mut Self::Real);

    /// `b - self * a`.
    fn take_from(self, a: Self, b: Self) -> Self;

    /// The lane-wise minimum.
    fn min(self, b: Self) -> Self;

    /// |self| where `there` is not zero, else 0.
    fn magnitude_where(self, there: Self) -> Self;

    /// `[low.7, self.0, …, self.6]`.
    fn shift_up(self, low: Self) -> Self;

    /// `[self.1, …, self.7, high.0]`.
    fn shift_down(self, high: Self) -> Self;

    /// `table[materials[i]]`; materials are below 16.
    fn look_up(table: &[Self::Real; 16], materials: &[u8; 8]) -> Self;

    /// Zero where `flags[i] & bit` is set.
    fn free(self, flags: &[u8; 8], bit: u8) -> Self;
}

/// Plain Rust; the compiler vectorises it with what the target has at least.
#[derive(Clone, Copy, Debug)]
pub struct Portable<R>([R; 8]);

impl<R: Real> Portable<R> {
    #[inline(always)]
    fn zip(self, b: Self, op: impl Fn(R, R) -> R) -> Self {
        Self(std::array::from_fn(|i| op(self.0[i], b.0[i])))
    }
}

impl<R: Real> Num for Portable<R> {
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self([R::splat(x); 8])
    }
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        self.zip(b, R::add)
    }
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        self.zip(b, R::sub)
    }
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        self.zip(b, R::mul)
    }
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        self.zip(b, R::div)
    }
    #[inline(always)]
    fn fma(self, a: Self, b: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i].fma(a.0[i], b.0[i])))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(R::sqrt))
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        self.zip(b, |x, y| if x > y { x } else { y })
    }
}

impl<R: Real> Lanes for Portable<R> {
    type Real = R;

    #[inline(always)]
    unsafe fn load(from: *const R) -> Self {
        // SAFETY: the caller promises eight readable numbers; no alignment is assumed.
        Self(unsafe { from.cast::<[R; 8]>().read_unaligned() })
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut R) {
        // SAFETY: the caller promises eight writable numbers; no alignment is assumed.
        unsafe { to.cast::<[R; 8]>().write_unaligned(self.0) }
    }
    #[inline(always)]
    fn take_from(self, a: Self, b: Self) -> Self {
        Self(std::array::from_fn(|i| b.0[i].sub(self.0[i].mul(a.0[i]))))
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        self.zip(b, |x, y| if x < y { x } else { y })
    }
    #[inline(always)]
    fn magnitude_where(self, there: Self) -> Self {
        let zero = R::default();
        let magnitude = |x: R| if x < zero { zero.sub(x) } else { x };
        self.zip(there, |x, t| if t == zero { zero } else { magnitude(x) })
    }
    #[inline(always)]
    fn shift_up(self, low: Self) -> Self {
        Self(std::array::from_fn(|i| if i == 0 { low.0[7] } else { self.0[i - 1] }))
    }
    #[inline(always)]
    fn shift_down(self, high: Self) -> Self {
        Self(std::array::from_fn(|i| if i == 7 { high.0[0] } else { self.0[i + 1] }))
    }
    #[inline(always)]
    fn look_up(table: &[R; 16], materials: &[u8; 8]) -> Self {
        Self(materials.map(|m| table[usize::from(m & 15)]))
    }
    #[inline(always)]
    fn free(self, flags: &[u8; 8], bit: u8) -> Self {
        Self(std::array::from_fn(|i| if flags[i] & bit == 0 { self.0[i] } else { R::default() }))
    }
}

#[cfg(target_arch = "x86_64")]
pub use avx2::{Avx2F32, Avx2F64};

/// Registers of 256 bits. Values of these types exist only inside functions compiled for AVX2 and FMA, which the caller
/// enters after asking the processor; that is what makes every intrinsic below sound.
#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;

    use super::{Lanes, Num};

    /// Eight `f32`.
    #[derive(Clone, Copy, Debug)]
    pub struct Avx2F32(__m256);

    /// Eight `f64` in two registers.
    #[derive(Clone, Copy, Debug)]
    pub struct Avx2F64(__m256d, __m256d);

    impl Num for Avx2F32 {
        #[inline(always)]
        fn splat(x: f64) -> Self {
            // SAFETY: see the module.
            Self(unsafe { _mm256_set1_ps(x as f32) })
        }
        #[inline(always)]
        fn add(self, b: Self) -> Self {
            // SAFETY: see the module.
            Self(unsafe { _mm256_add_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn sub(self, b: Self) -> Self {
            // SAFETY: see the module.
            Self(unsafe { _mm256_sub_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn mul(self, b: Self) -> Self {
            // SAFETY: see the module.
            Self(unsafe { _mm256_mul_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn div(self, b: Self) -> Self {
            // SAFETY: see the module.
            Self(unsafe { _mm256_div_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn fma(self, a: Self, b: Self) -> Self {
            // SAFETY: see the module.
            Self(unsafe { _mm256_fmadd_ps(self.0, a.0, b.0) })
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: see the module.
            Self(unsafe { _mm256_sqrt_ps(self.0) })
        }
        #[inline(always)]
        fn max(self, b: Self) -> Self {
            // SAFETY: see the module.
            Self(unsafe { _mm256_max_ps(self.0, b.0) })
        }
    }

    impl Lanes for Avx2F32 {
        type Real = f32;

        #[inline(always)]
        unsafe fn load(from: *const f32) -> Self {
            // SAFETY: the caller promises eight readable numbers.
            Self(unsafe { _mm256_loadu_ps(from) })
        }
        #[inline(always)]
        unsafe fn store(self, to: *mut f32) {
            // SAFETY: the caller promises eight writable numbers.
            unsafe { _mm256_storeu_ps(to, self.0) }
        }
        #[inline(always)]
        fn take_from(self, a: Self, b: Self) -> Self {
            // SAFETY: see the module.
            Self(unsafe { _mm256_fnmadd_ps(self.0, a.0, b.0) })
        }
        #[inline(always)]
        fn min(self, b: Self) -> Self {
            // SAFETY: see the module.
            Self(unsafe { _mm256_min_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn magnitude_where(self, there: Self) -> Self {
            // SAFETY: see the module.
            unsafe {
                let mask = _mm256_cmp_ps::<_CMP_NEQ_OQ>(there.0, _mm256_setzero_ps());
                let mask = _mm256_andnot_ps(_mm256_set1_ps(-0.0), mask);
                Self(_mm256_and_ps(mask, self.0))
            }
        }
        #[inline(always)]
        fn shift_up(self, low: Self) -> Self {
            // SAFETY: see the module.
            unsafe {
                let (a, b) = (_mm256_castps_si256(self.0), _mm256_castps_si256(low.0));
                let joined = _mm256_permute2x128_si256::<0x21>(b, a);
                Self(_mm256_castsi256_ps(_mm256_alignr_epi8::<12>(a, joined)))
            }
        }
        #[inline(always)]
        fn shift_down(self, high: Self) -> Self {
            // SAFETY: see the module.
            unsafe {
                let (a, b) = (_mm256_castps_si256(self.0), _mm256_castps_si256(high.0));
                let joined = _mm256_permute2x128_si256::<0x21>(a, b);
                Self(_mm256_castsi256_ps(_mm256_alignr_epi8::<4>(joined, a)))
            }
        }
        #[inline(always)]
        fn look_up(table: &[f32; 16], materials: &[u8; 8]) -> Self {
            // SAFETY: see the module; both halves of the table and the materials are whole arrays.
            unsafe {
                // A permutation looks at the low three bits; the fourth becomes the sign that blends the halves.
                let index = _mm256_cvtepu8_epi32(_mm_loadl_epi64(materials.as_ptr().cast()));
                let low = _mm256_permutevar8x32_ps(_mm256_loadu_ps(table.as_ptr()), index);
                let high = _mm256_permutevar8x32_ps(_mm256_loadu_ps(table.as_ptr().add(8)), index);
                Self(_mm256_blendv_ps(low, high, _mm256_castsi256_ps(_mm256_slli_epi32::<28>(index))))
            }
        }
        #[inline(always)]
        fn free(self, flags: &[u8; 8], bit: u8) -> Self {
            // SAFETY: see the module; eight flags are a whole array.
            unsafe {
                let flags = _mm256_cvtepu8_epi32(_mm_loadl_epi64(flags.as_ptr().cast()));
                let bit = _mm256_set1_epi32(i32::from(bit));
                let held = _mm256_cmpeq_epi32(_mm256_and_si256(flags, bit), bit);
                Self(_mm256_andnot_ps(_mm256_castsi256_ps(held), self.0))
            }
        }
    }

    /// `[b.3, a.0, a.1, a.2]`.
    #[inline(always)]
    unsafe fn up(a: __m256d, b: __m256d) -> __m256d {
        // SAFETY: see the module.
        unsafe { _mm256_shuffle_pd::<0b0101>(_mm256_permute2f128_pd::<0x21>(b, a), a) }
    }

    /// `[a.1, a.2, a.3, b.0]`.
    #[inline(always)]
    unsafe fn down(a: __m256d, b: __m256d) -> __m256d {
        // SAFETY: see the module.
        unsafe { _mm256_shuffle_pd::<0b0101>(a, _mm256_permute2f128_pd::<0x21>(a, b)) }
    }

    impl Num for Avx2F64 {
        #[inline(always)]
        fn splat(x: f64) -> Self {
            // SAFETY: see the module.
            unsafe { Self(_mm256_set1_pd(x), _mm256_set1_pd(x)) }
        }
        #[inline(always)]
        fn add(self, b: Self) -> Self {
            // SAFETY: see the module.
            unsafe { Self(_mm256_add_pd(self.0, b.0), _mm256_add_pd(self.1, b.1)) }
        }
        #[inline(always)]
        fn sub(self, b: Self) -> Self {
            // SAFETY: see the module.
            unsafe { Self(_mm256_sub_pd(self.0, b.0), _mm256_sub_pd(self.1, b.1)) }
        }
        #[inline(always)]
        fn mul(self, b: Self) -> Self {
            // SAFETY: see the module.
            unsafe { Self(_mm256_mul_pd(self.0, b.0), _mm256_mul_pd(self.1, b.1)) }
        }
        #[inline(always)]
        fn div(self, b: Self) -> Self {
            // SAFETY: see the module.
            unsafe { Self(_mm256_div_pd(self.0, b.0), _mm256_div_pd(self.1, b.1)) }
        }
        #[inline(always)]
        fn fma(self, a: Self, b: Self) -> Self {
            // SAFETY: see the module.
            unsafe { Self(_mm256_fmadd_pd(self.0, a.0, b.0), _mm256_fmadd_pd(self.1, a.1, b.1)) }
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: see the module.
            unsafe { Self(_mm256_sqrt_pd(self.0), _mm256_sqrt_pd(self.1)) }
        }
        #[inline(always)]
        fn max(self, b: Self) -> Self {
            // SAFETY: see the module.
            unsafe { Self(_mm256_max_pd(self.0, b.0), _mm256_max_pd(self.1, b.1)) }
        }
    }

    impl Lanes for Avx2F64 {
        type Real = f64;

        #[inline(always)]
        unsafe fn load(from: *const f64) -> Self {
            // SAFETY: the caller promises eight readable numbers.
            unsafe { Self(_mm256_loadu_pd(from), _mm256_loadu_pd(from.add(4))) }
        }
        #[inline(always)]
        unsafe fn store(self, to: *mut f64) {
            // SAFETY: the caller promises eight writable numbers.
            unsafe {
                _mm256_storeu_pd(to, self.0);
                _mm256_storeu_pd(to.add(4), self.1);
            }
        }
        #[inline(always)]
        fn take_from(self, a: Self, b: Self) -> Self {
            // SAFETY: see the module.
            unsafe { Self(_mm256_fnmadd_pd(self.0, a.0, b.0), _mm256_fnmadd_pd(self.1, a.1, b.1)) }
        }
        #[inline(always)]
        fn min(self, b: Self) -> Self {
            // SAFETY: see the module.
            unsafe { Self(_mm256_min_pd(self.0, b.0), _mm256_min_pd(self.1, b.1)) }
        }
        #[inline(always)]
        fn magnitude_where(self, there: Self) -> Self {
            // SAFETY: see the module.
            unsafe {
                let zero = _mm256_setzero_pd();
                let low = _mm256_cmp_pd::<_CMP_NEQ_OQ>(there.0, zero);
                let high = _mm256_cmp_pd::<_CMP_NEQ_OQ>(there.1, zero);
                let sign = _mm256_set1_pd(-0.0);
                let low = _mm256_andnot_pd(sign, low);
                let high = _mm256_andnot_pd(sign, high);
                Self(_mm256_and_pd(low, self.0), _mm256_and_pd(high, self.1))
            }
        }
        #[inline(always)]
        fn shift_up(self, low: Self) -> Self {
            // SAFETY: see the module.
            unsafe { Self(up(self.0, low.1), up(self.1, self.0)) }
        }
        #[inline(always)]
        fn shift_down(self, high: Self) -> Self {
            // SAFETY: see the module.
            unsafe { Self(down(self.0, self.1), down(self.1, high.0)) }
        }
        #[inline(always)]
        fn look_up(table: &[f64; 16], materials: &[u8; 8]) -> Self {
            let picked = materials.map(|m| table[usize::from(m & 15)]);
            // SAFETY: a whole array of eight.
            unsafe { Self::load(picked.as_ptr()) }
        }
        #[inline(always)]
        fn free(self, flags: &[u8; 8], bit: u8) -> Self {
            // SAFETY: see the module; eight flags are a whole array.
            unsafe {
                let flags = _mm_loadl_epi64(flags.as_ptr().cast());
                let bit = _mm256_set1_epi64x(i64::from(bit));
                let low = _mm256_cvtepu8_epi64(flags);
                let high = _mm256_cvtepu8_epi64(_mm_srli_si128::<4>(flags));
                let low = _mm256_cmpeq_epi64(_mm256_and_si256(low, bit), bit);
                let high = _mm256_cmpeq_epi64(_mm256_and_si256(high, bit), bit);
                Self(
                    _mm256_andnot_pd(_mm256_castsi256_pd(low), self.0),
                    _mm256_andnot_pd(_mm256_castsi256_pd(high), self.1),
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a shift, a lookup and a mask give, one lane at a time.
    fn check<L: Lanes>() {
        let put = |x: [f64; 8]| {
            let reals = x.map(L::Real::splat);
            // SAFETY: a whole array of eight.
            unsafe { L::load(reals.as_ptr()) }
        };
        let get = |l: L| {
            let mut out = [L::Real::default(); 8];
            // SAFETY: a whole array of eight.
            unsafe { l.store(out.as_mut_ptr()) };
            out.map(L::Real::to_f64)
        };
        let a: [f64; 8] = std::array::from_fn(|i| i as f64);
        let b: [f64; 8] = std::array::from_fn(|i| 10.0 + i as f64);

        assert_eq!(get(put(a).shift_up(put(b))), [17.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(get(put(a).shift_down(put(b))), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 10.0]);
        assert_eq!(get(put(a).max(put([3.5; 8]))), [3.5, 3.5, 3.5, 3.5, 4.0, 5.0, 6.0, 7.0]);
        assert_eq!(get(put(a).min(put([3.5; 8]))), [0.0, 1.0, 2.0, 3.0, 3.5, 3.5, 3.5, 3.5]);
        let there = [0.0, 1.0, -2.0, 0.0, 5.0, 0.0, 7.0, -0.0];
        let signs: [f64; 8] = std::array::from_fn(|i| if i % 3 == 0 { b[i] } else { -b[i] });
        assert_eq!(get(put(signs).magnitude_where(put(there))), [0.0, 11.0, 12.0, 0.0, 14.0, 0.0, 16.0, 0.0]);
        assert_eq!(get(put(a).take_from(put(b), put(a))), std::array::from_fn(|i| a[i] - a[i] * b[i]));
        assert_eq!(get(put(a).fma(put(b), put(a))), std::array::from_fn(|i| a[i] * b[i] + a[i]));

        let table = std::array::from_fn(|i| L::Real::splat(100.0 + i as f64));
        let materials = std::array::from_fn(|i| i as u8 * 2 + 1);
        assert_eq!(get(L::look_up(&table, &materials)), std::array::from_fn(|i| 101.0 + 2.0 * i as f64));

        let flags = [0, 1, 2, 3, 4, 5, 6, 7];
        assert_eq!(get(put(b).free(&flags, 2)), [10.0, 11.0, 0.0, 0.0, 14.0, 15.0, 0.0, 0.0]);
    }

    #[test]
    fn lanes_move_look_up_and_mask_alike_on_every_route() {
        check::<Portable<f32>>();
        check::<Portable<f64>>();
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma") {
            check::<Avx2F32>();
            check::<Avx2F64>();
        }
    }
}
