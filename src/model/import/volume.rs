//! The voxels of a volume file, whatever the format of its header.

use std::io::{BufRead, BufReader, ErrorKind, Read};

use flate2::bufread::MultiGzDecoder;

use crate::error::{Error, Result};
use crate::model::grid::{LabelGrid, voxel_count};
use crate::model::intensity::IntensityGrid;
use crate::model::placement::Affine;

/// Most bytes that one byte of a deflate stream can become.
const DEFLATE_RATIO: u64 = 1032;

/// Bytes that are decoded at a time; a multiple of every voxel's size.
const CHUNK: usize = 1 << 16;

/// Longest number in a text file.
const LONGEST_NUMBER: usize = 64;

/// A stream of bytes and the most that it can still hold.
pub(super) struct Source {
    pub(super) what: String,
    pub(super) reader: Box<dyn BufRead>,
    pub(super) capacity: u64,
}

impl Source {
    /// The stream inside a gzip stream.
    pub(super) fn inflated(self) -> Self {
        Self {
            reader: Box::new(BufReader::new(MultiGzDecoder::new(self.reader))),
            capacity: self.capacity.saturating_mul(DEFLATE_RATIO),
            ..self
        }
    }

    pub(super) fn refuse(&self, reason: impl Into<String>) -> Error {
        Error::format(&self.what, reason)
    }

    pub(super) fn unsupported(&self, reason: &str) -> Error {
        Error::Unsupported(format!("{}: {reason}", self.what))
    }

    /// Fills `bytes` or says why not.
    pub(super) fn read_exact(&mut self, bytes: &mut [u8]) -> Result<()> {
        self.reader.read_exact(bytes).map_err(|e| read_error(&self.what, e))?;
        self.capacity = self.capacity.saturating_sub(bytes.len() as u64);
        Ok(())
    }

    /// Passes over `count` bytes.
    pub(super) fn skip(&mut self, count: u64) -> Result<()> {
        let skipped = std::io::copy(&mut (&mut self.reader).take(count), &mut std::io::sink())
            .map_err(|e| read_error(&self.what, e))?;
        if skipped < count {
            return Err(read_error(&self.what, ErrorKind::UnexpectedEof.into()));
        }
        self.capacity = self.capacity.saturating_sub(count);
        Ok(())
    }
}

/// An error of the operating system, or of the decompressor, which reports through the same type.
pub(super) fn read_error(what: &str, error: std::io::Error) -> Error {
    match error.kind() {
        ErrorKind::UnexpectedEof => Error::format(what, "the file ends too early"),
        ErrorKind::InvalidInput | ErrorKind::InvalidData => {
            Error::format(what, format!("the compressed data is damaged: {error}"))
        }
        _ => Error::Io { path: what.into(), reason: error },
    }
}

/// The number type of a voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl Scalar {
    pub(super) fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    /// Replaces `values` by the numbers in `bytes`. Integers beyond 2⁵³ lose digits; no label and no scan has
    /// any.
    fn decode(self, bytes: &[u8], is_big_endian: bool, values: &mut Vec<f64>) {
        let big = is_big_endian;
        match self {
            Self::U8 => convert(bytes, big, values, |b| f64::from(u8::from_le_bytes(b))),
            Self::I8 => convert(bytes, big, values, |b| f64::from(i8::from_le_bytes(b))),
            Self::U16 => convert(bytes, big, values, |b| f64::from(u16::from_le_bytes(b))),
            Self::I16 => convert(bytes, big, values, |b| f64::from(i16::from_le_bytes(b))),
            Self::U32 => convert(bytes, big, values, |b| f64::from(u32::from_le_bytes(b))),
            Self::I32 => convert(bytes, big, values, |b| f64::from(i32::from_le_bytes(b))),
            Self::U64 => convert(bytes, big, values, |b| u64::from_le_bytes(b) as f64),
            Self::I64 => convert(bytes, big, values, |b| i64::from_le_bytes(b) as f64),
            Self::F32 => convert(bytes, big, values, |b| f64::from(f32::from_le_bytes(b))),
            Self::F64 => convert(bytes, big, values, f64::from_le_bytes),
        }
    }
}

fn convert<const N: usize>(
    bytes: &[u8],
    is_big_endian: bool,
    values: &mut Vec<f64>,
    number: impl Fn([u8; N]) -> f64,
) {
    let (voxels, _) = bytes.as_chunks::<N>();
    values.clear();
    values.extend(voxels.iter().map(|&voxel| {
        let mut little = voxel;
        if is_big_endian {
            little.reverse();
        }
        number(little)
    }));
}

/// How voxels are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Numbers of one type, one after the other.
    Binary { scalar: Scalar, is_big_endian: bool },
    /// Decimal numbers with white space between them.
    Text,
}

/// A volume whose header is read and checked and whose voxels follow in the stream.
pub(super) struct Volume {
    source: Source,
    dims: [usize; 3],
    count: usize,
    /// Voxel index to world, RAS, metres.
    affine: Affine,
    encoding: Encoding,
    /// Value = slope × stored number + intercept.
    scaling: Option<[f64; 2]>,
}

impl Volume {
    /// Refuses a volume that is larger than the stream can be.
    pub(super) fn new(
        source: Source,
        dims: [usize; 3],
        affine: Affine,
        encoding: Encoding,
        scaling: Option<[f64; 2]>,
    ) -> Result<Self> {
        let count = voxel_count(dims).map_err(|e| source.refuse(e.to_string()))?;
        let least = match encoding {
            Encoding::Binary { scalar, .. } => count as u64 * scalar.size() as u64,
            // A digit each and a space between.
            Encoding::Text => count as u64 * 2 - 1,
        };
        if least > source.capacity {
            return Err(source.refuse(format!(
                "the header promises {dims:?} voxels, at least {least} bytes, but no more than {} can follow",
                source.capacity
            )));
        }
        Ok(Self { source, dims, count, affine, encoding, scaling })
    }

    pub(super) fn into_labels(self) -> Result<LabelGrid> {
        let (what, dims, affine) = (self.source.what.clone(), self.dims, self.affine);
        let labels = self.collect(|value, voxel| {
            label(value).ok_or_else(|| format!("voxel {voxel} holds {value}, and a label is 0 to 65535"))
        })?;
        LabelGrid::from_affine(dims, &affine, labels).map_err(|e| placing_error(&what, e))
    }

    pub(super) fn into_intensities(self) -> Result<IntensityGrid> {
        let (what, dims, affine) = (self.source.what.clone(), self.dims, self.affine);
        let values = self.collect(|value, _| Ok(value as f32))?;
        IntensityGrid::from_affine(dims, &affine, values).map_err(|e| placing_error(&what, e))
    }

    /// All voxels in the file's order, each made from its scaled value and its index.
    fn collect<T>(mut self, make: impl Fn(f64, usize) -> Result<T, String>) -> Result<Vec<T>> {
        let mut voxels = Vec::new();
        voxels.try_reserve_exact(self.count).map_err(|_| {
            Error::Limit(format!("{}: there is no memory for {} voxels", self.source.what, self.count))
        })?;

        let mut values = Vec::new();
        while voxels.len() < self.count {
            let wanted = self.count - voxels.len();
            match self.encoding {
                Encoding::Binary { scalar, is_big_endian } => {
                    let mut bytes = [0; CHUNK];
                    let bytes = &mut bytes[..CHUNK.min(wanted.saturating_mul(scalar.size()))];
                    self.source.read_exact(bytes)?;
                    scalar.decode(bytes, is_big_endian, &mut values);
                }
                Encoding::Text => {
                    values.clear();
                    values.push(self.next_number()?);
                }
            }
            for &value in &values {
                let scaled = self.scaling.map_or(value, |[slope, intercept]| slope * value + intercept);
                let voxel = make(scaled, voxels.len()).map_err(|reason| self.source.refuse(reason))?;
                voxels.push(voxel);
            }
        }

        self.expect_end()?;
        Ok(voxels)
    }

    /// The next number of a text.
    fn next_number(&mut self) -> Result<f64> {
        let mut token = String::new();
        for byte in self.source.reader.by_ref().bytes() {
            let byte = byte.map_err(|e| read_error(&self.source.what, e))?;
            if !byte.is_ascii_whitespace() {
                token.push(char::from(byte));
            } else if !token.is_empty() {
                break;
            }
            if token.len() > LONGEST_NUMBER {
                break;
            }
        }
        if token.is_empty() {
            return Err(self.source.refuse("the file ends too early"));
        }
        token.parse().map_err(|_| self.source.refuse(format!("'{token}' is not a number")))
    }

    /// Reads to the end of the stream, where gzip keeps its checksum, and refuses voxels that the header does
    /// not name.
    fn expect_end(&mut self) -> Result<()> {
        let Source { what, reader, .. } = &mut self.source;
        loop {
            let rest = reader.fill_buf().map_err(|e| read_error(what, e))?;
            let length = rest.len();
            if length == 0 {
                return Ok(());
            }
            if self.encoding != Encoding::Text || !rest.iter().all(u8::is_ascii_whitespace) {
                return Err(Error::format(&*what, "more data follows than the header promises"));
            }
            reader.consume(length);
        }
    }
}

/// A label from a scaled value. Scaling in single precision may leave the nearest whole number by a little.
fn label(value: f64) -> Option<u16> {
    let whole = value.round();
    let is_label = (value - whole).abs() <= 1e-3 && (0.0..=f64::from(u16::MAX)).contains(&whole);
    is_label.then_some(whole as u16)
}

/// A grid refuses its placing as an argument; here the argument came from a file.
fn placing_error(what: &str, error: Error) -> Error {
    match error {
        Error::Argument(reason) => Error::format(what, reason),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scalar_decodes_in_both_byte_orders() {
        fn check<const N: usize>(scalar: Scalar, little: [u8; N], expected: f64) {
            let mut big = little;
            big.reverse();
            let mut values = Vec::new();
            for (bytes, is_big) in [(little, false), (big, true)] {
                scalar.decode(&bytes, is_big, &mut values);
                assert_eq!((values.as_slice(), scalar.size()), (&[expected][..], N), "{scalar:?}");
            }
        }
        check(Scalar::U8, [200], 200.0);
        check(Scalar::I8, [0xff], -1.0);
        check(Scalar::U16, 60_000_u16.to_le_bytes(), 60_000.0);
        check(Scalar::I16, (-1024_i16).to_le_bytes(), -1024.0);
        check(Scalar::U32, 4_000_000_000_u32.to_le_bytes(), 4e9);
        check(Scalar::I32, (-70_000_i32).to_le_bytes(), -70_000.0);
        check(Scalar::U64, (1_u64 << 40).to_le_bytes(), 1_099_511_627_776.0);
        check(Scalar::I64, (-(1_i64 << 40)).to_le_bytes(), -1_099_511_627_776.0);
        check(Scalar::F32, 0.5_f32.to_le_bytes(), 0.5);
        check(Scalar::F64, (-0.1_f64).to_le_bytes(), -0.1);
    }

    #[test]
    fn labels_are_whole_numbers_from_0_to_65535() {
        assert_eq!([0.0, 65_535.0, 2.999_9].map(label), [Some(0), Some(65_535), Some(3)]);
        assert_eq!([-1.0, 65_536.0, 0.5, f64::NAN, f64::INFINITY].map(label), [None; 5]);
    }
}
