//! The border itself: panics stop here, and everything that a host passes is checked and copied.

use std::any::Any;
use std::ffi::{CStr, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use super::status::{
    Fault, PLP_ERR_LIMIT, PLP_ERR_PANIC, PLP_ERR_STRUCT_SIZE, PLP_ERR_UNSUPPORTED, plp_status, set_last_error,
};

/// Runs the body of an exported function: an error becomes its status and the last error, a panic
/// `PLP_ERR_PANIC`.
pub(super) fn boundary(body: impl FnOnce() -> Result<plp_status, Fault>) -> plp_status {
    let fault = match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(status)) => return status,
        Ok(Err(fault)) => fault,
        Err(panic) => panic_fault(panic.as_ref()),
    };
    set_last_error(&fault.message);
    fault.status
}

/// Runs the body of an @rt function: it deals in statuses only, and touches neither the allocator nor a
/// thread-local.
pub(super) fn rt_boundary(body: impl FnOnce() -> Result<plp_status, plp_status>) -> plp_status {
    match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(status) | Err(status)) => status,
        Err(_) => PLP_ERR_PANIC,
    }
}

/// A caught panic as a fault.
pub(super) fn panic_fault(payload: &(dyn Any + Send)) -> Fault {
    let text = payload
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| payload.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("no message");
    Fault::new(PLP_ERR_PANIC, format!("a defect of the library was contained: {text}"))
}

/// The longest start of `text` that fits `bytes` and ends between two characters.
pub(super) fn fitting(text: &str, bytes: usize) -> &str {
    // A NUL inside would end the text for every C reader anyway.
    let text = text.split('\0').next().unwrap_or_default();
    &text[..text.floor_char_boundary(bytes)]
}

/// Copies text into a fixed array of C characters, cut between characters, always ended by NUL.
pub(super) fn fill_text<const N: usize>(text: &str) -> [c_char; N] {
    let mut out = [0; N];
    for (to, from) in out.iter_mut().zip(fitting(text, N - 1).bytes()) {
        *to = from.cast_signed() as c_char;
    }
    out
}

/// The text of a fixed array of C characters.
pub(super) fn read_text(chars: &[c_char], what: &str) -> Result<String, Fault> {
    let bytes: Vec<u8> = chars.iter().map(|&c| c as u8).take_while(|&b| b != 0).collect();
    if bytes.len() == chars.len() {
        return Err(Fault::argument(format!("{what} does not end in NUL")));
    }
    String::from_utf8(bytes).map_err(|_| Fault::argument(format!("{what} is not UTF-8")))
}

/// The text of a string from the host.
///
/// # Safety
/// `text` is NULL or points to a string that ends in NUL.
pub(super) unsafe fn read_str<'a>(text: *const c_char, what: &str) -> Result<&'a str, Fault> {
    if text.is_null() {
        return Err(Fault::null(what));
    }
    // SAFETY: promised by the caller.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map_err(|_| Fault::argument(format!("{what} is not UTF-8")))
}

/// A struct of the ABI that may grow at its end and starts with `struct_size`.
///
/// # Safety The type is `repr(C)`, has no padding that is not named, starts with `struct_size: u32`, and any
/// bytes make a valid value.
pub(super) unsafe trait Desc: Copy {
    /// The header's name of the type.
    const NAME: &'static str;
    /// The end of its last field in the first version of this ABI: no caller can have a smaller one. Names that field
    /// and not the type's size, which grows.
    const FIRST_SIZE: usize;
    /// The defaults, with `struct_size` set.
    fn with_defaults() -> Self;
}

/// No struct will ever be as large: a size beyond it is a wrong pointer or an uninitialised struct.
const LARGEST_STRUCT: usize = 4096;

fn check_size<D: Desc>(size: usize) -> Result<(), Fault> {
    if (D::FIRST_SIZE..=LARGEST_STRUCT).contains(&size) {
        return Ok(());
    }
    Err(Fault::new(
        PLP_ERR_STRUCT_SIZE,
        format!("{size} is not the size of a {0}; set struct_size with {0}_init or sizeof", D::NAME),
    ))
}

/// Fills a caller's desc of `size` bytes with defaults; what this library does not know is zero.
///
/// # Safety
/// `desc` is NULL or points to `size` writable bytes.
pub(super) unsafe fn init_desc<D: Desc>(desc: *mut D, size: u32) -> Result<plp_status, Fault> {
    if desc.is_null() {
        return Err(Fault::null(D::NAME));
    }
    check_size::<D>(size as usize)?;
    let ours = D::with_defaults();
    let known = (size as usize).min(size_of::<D>());
    // SAFETY: `size` bytes are writable and `known` is at most that and at most our size; a `D` starts with
    // its `struct_size`.
    unsafe {
        desc.cast::<u8>().write_bytes(0, size as usize);
        std::ptr::copy_nonoverlapping((&raw const ours).cast::<u8>(), desc.cast::<u8>(), known);
        desc.cast::<u32>().write_unaligned(size);
    }
    Ok(super::status::PLP_OK)
}

/// A caller's desc over our defaults: older callers know less, and newer ones may only ask for what we know.
///
/// # Safety
/// `desc` is NULL or points to as many readable bytes as its first field says.
pub(super) unsafe fn read_desc<D: Desc>(desc: *const D) -> Result<D, Fault> {
    if desc.is_null() {
        return Err(Fault::null(D::NAME));
    }
    let mut ours = D::with_defaults();
    // SAFETY: a desc starts with its size, and the caller promises that many bytes.
    let size = unsafe { desc.cast::<u32>().read_unaligned() } as usize;
    check_size::<D>(size)?;
    let known = size.min(size_of::<D>());
    // SAFETY: `known` bytes are readable there and writable here, and any bytes make a valid `D`.
    unsafe { std::ptr::copy_nonoverlapping(desc.cast::<u8>(), (&raw mut ours).cast::<u8>(), known) };
    // SAFETY: bytes from `known` up to `size` belong to the caller's struct.
    let unknown = unsafe { std::slice::from_raw_parts(desc.cast::<u8>().add(known), size - known) };
    if unknown.iter().any(|&byte| byte != 0) {
        return Err(Fault::new(
            PLP_ERR_UNSUPPORTED,
            format!(
                "this {} comes from a newer header and sets a field that this library does not know",
                D::NAME
            ),
        ));
    }
    Ok(ours)
}

/// Copies an array from the host; empty for a count of 0.
///
/// # Safety
/// `from` is NULL or points to `count` readable values, `stride` bytes apart; any bytes make a valid `T`.
pub(super) unsafe fn read_array<T: Copy>(
    from: *const T,
    count: usize,
    stride: usize,
    what: &str,
) -> Result<Vec<T>, Fault> {
    if count == 0 {
        return Ok(Vec::new());
    }
    if from.is_null() {
        return Err(Fault::null(what));
    }
    if stride < size_of::<T>() {
        return Err(Fault::argument(format!(
            "a stride of {stride} bytes in {what} is less than its elements' {}",
            size_of::<T>()
        )));
    }
    let too_large =
        || Fault::new(PLP_ERR_LIMIT, format!("{what} with {count} elements does not fit in memory"));
    count.checked_mul(stride).filter(|&bytes| isize::try_from(bytes).is_ok()).ok_or_else(too_large)?;
    let mut copy = Vec::new();
    copy.try_reserve_exact(count).map_err(|_| too_large())?;
    // SAFETY: element i lies `i * stride` bytes on, which the check above keeps within an allocation; hosts
    // need not align it.
    copy.extend((0..count).map(|i| unsafe { from.byte_add(i * stride).read_unaligned() }));
    Ok(copy)
}

/// Copies an array of tightly packed values from the host.
///
/// # Safety
/// As [`read_array`], with a stride of the size of a `T`.
pub(super) unsafe fn read_list<T: Copy>(from: *const T, count: usize, what: &str) -> Result<Vec<T>, Fault> {
    // SAFETY: promised by the caller.
    unsafe { read_array(from, count, size_of::<T>(), what) }
}

/// Checks an output pointer before any work is done.
pub(super) fn check_out<T>(out: *mut T, what: &str) -> Result<(), Fault> {
    if out.is_null() { Err(Fault::null(what)) } else { Ok(()) }
}

/// A struct that the library fills and that may grow at its end; its size follows it in the parameter list.
///
/// # Safety
/// The type is `repr(C)` and has no padding that is not named.
pub(super) unsafe trait Output: Copy {
    /// The header's name of the type.
    const NAME: &'static str;
    /// The end of its last field in the first version of this ABI, as for [`Desc`].
    const FIRST_SIZE: usize;
}

/// Checks an output struct before any work is done.
pub(super) fn check_output<T: Output>(out: *mut T, size: u32) -> Result<(), Fault> {
    check_out(out, T::NAME)?;
    if (T::FIRST_SIZE..=LARGEST_STRUCT).contains(&(size as usize)) {
        return Ok(());
    }
    Err(Fault::new(
        PLP_ERR_STRUCT_SIZE,
        format!("{size} is not the size of a {0}; pass sizeof({0})", T::NAME),
    ))
}

/// Writes an output struct into a caller's `size` bytes; what this library does not know becomes zero.
///
/// # Safety
/// [`check_output`] passed, and `out` points to `size` writable bytes.
pub(super) unsafe fn write_output<T: Output>(out: *mut T, size: u32, value: &T) {
    let size = size as usize;
    // SAFETY: the caller promises `size` writable bytes; a `T` is at least as long as what is copied from it.
    unsafe {
        out.cast::<u8>().write_bytes(0, size);
        std::ptr::copy_nonoverlapping(
            std::ptr::from_ref(value).cast::<u8>(),
            out.cast::<u8>(),
            size.min(size_of::<T>()),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::super::status::{PLP_ERR_NULL, PLP_OK};
    use super::*;

    #[repr(C)]
    #[derive(Clone, Copy, Debug, PartialEq)]
    struct Thing {
        struct_size: u32,
        old: u32,
        new: u32,
    }
    // SAFETY: repr(C), three integers, `struct_size` first.
    unsafe impl Desc for Thing {
        const NAME: &'static str = "thing";
        const FIRST_SIZE: usize = 8;
        fn with_defaults() -> Self {
            Self { struct_size: 12, old: 5, new: 6 }
        }
    }

    fn read(words: &[u32]) -> Result<Thing, Fault> {
        // SAFETY: the tests give slices at least as long as their first word says.
        unsafe { read_desc(words.as_ptr().cast::<Thing>()) }
    }

    #[test]
    fn an_older_callers_struct_takes_our_defaults() {
        assert_eq!(read(&[8, 1]).unwrap(), Thing { struct_size: 8, old: 1, new: 6 });
        assert_eq!(read(&[12, 1, 2]).unwrap().new, 2);
    }

    #[test]
    fn a_newer_callers_struct_must_leave_unknown_fields_zero() {
        assert_eq!(read(&[16, 1, 2, 0]).unwrap().new, 2);
        assert_eq!(read(&[16, 1, 2, 9]).unwrap_err().status, PLP_ERR_UNSUPPORTED);
    }

    #[test]
    fn impossible_struct_sizes_are_refused() {
        for size in [0, 4, 7, 4097, u32::MAX] {
            assert_eq!(read(&[size, 0, 0]).unwrap_err().status, PLP_ERR_STRUCT_SIZE);
        }
    }

    #[test]
    fn init_fills_newer_structs_with_zeros() {
        let mut words = [99_u32; 5];
        // SAFETY: 16 of 20 bytes are offered.
        let status = unsafe { init_desc(words.as_mut_ptr().cast::<Thing>(), 16) }.unwrap();
        assert_eq!((status, words), (PLP_OK, [16, 5, 6, 0, 99]));
    }

    #[test]
    fn a_panic_becomes_a_status_with_its_message() {
        assert_eq!(boundary(|| panic!("tissue number {}", 7)), PLP_ERR_PANIC);
        // SAFETY: this thread's own buffer.
        let message = unsafe { CStr::from_ptr(super::super::status::plp_last_error()) };
        assert!(message.to_str().unwrap().ends_with("tissue number 7"));
    }

    #[test]
    fn arrays_are_read_by_stride_and_unaligned() {
        let bytes: Vec<u8> = (0..16).collect();
        // SAFETY: elements at bytes 1 and 9 of 16.
        let read =
            unsafe { read_array(bytes.as_ptr().wrapping_add(1).cast::<[u8; 4]>(), 2, 8, "array") }.unwrap();
        assert_eq!(read, [[1, 2, 3, 4], [9, 10, 11, 12]]);
        // SAFETY: nothing is read.
        let null = unsafe { read_list(std::ptr::null::<u32>(), 3, "array") };
        assert_eq!(null.unwrap_err().status, PLP_ERR_NULL);
    }

    #[test]
    fn text_is_cut_between_characters() {
        assert_eq!(fitting("aäb", 2), "a");
        let chars: [c_char; 4] = fill_text("aäb");
        assert_eq!(read_text(&chars, "text").unwrap(), "aä");
        assert_eq!(read_text(&[1; 4], "text").unwrap_err().status, super::super::status::PLP_ERR_ARGUMENT);
    }
}
