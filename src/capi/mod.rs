//! The C ABI: thin, one file per noun. Nothing in the crate imports it.
//!
//! `include/palpate/palpate.h` is generated from these files, so the comments of public items are written for
//! C readers. `include/README.md` states the rules that all functions share.
//!
//! | file | subject |
//! |---|---|
//! | [`types`] | data that crosses the border, and its defaults |
//! | [`status`] | status codes, the one table from [`Error`](crate::error::Error) to a code, the last error |
//! | `boundary` | panics stop here; descs and arrays are copied in, values are copied out |
//! | `handle`, `aside` | opaque pointers that survive misuse, and what a busy one said last |
//! | `convert` | between the structs of the header and the types of the crate |
//! | [`version`], [`preset`], [`model`], [`device`], [`sim`], [`drive`], [`change`], [`cut`], [`mod@snapshot`], [`statistics`], [`tool`], [`surface`] | the functions of one noun |

// The header's names, which are C's.
#![allow(non_camel_case_types)]
// Comments become the header: what a C caller must observe stands in include/README.md and in each
// parameter's text.
#![allow(clippy::missing_safety_doc)]

mod aside;
mod boundary;
pub mod change;
mod convert;
pub mod cut;
pub mod device;
pub mod drive;
mod handle;
pub mod model;
pub mod preset;
pub mod sim;
pub mod snapshot;
pub mod statistics;
pub mod status;
pub mod surface;
pub mod tool;
pub mod types;
pub mod version;
