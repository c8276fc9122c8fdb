//! NRRD with its voxels in the same file; encodings raw, gzip and text.
//!
//! Three axes must be spatial (those with a space direction, else the first three) and every other axis of
//! length 1. The place of the voxels comes from space directions and origin; without them, from the spacings,
//! with the first voxel at the origin. Lengths are in the file's unit; millimetres where it names none.

use std::collections::BTreeMap;
use std::io::{BufRead, Read};

use super::volume::{Encoding, Scalar, Source, Volume, read_error};
use crate::error::Result;
use crate::math::{Mat3, Vec3};
use crate::model::placement::Affine;

/// Longest header, in bytes.
const LONGEST_HEADER: u64 = 1 << 20;
/// Most axes that the format allows.
const MOST_AXES: usize = 16;

pub(super) fn open(mut source: Source) -> Result<Volume> {
    let fields = Fields::read(&mut source)?;
    if fields.get("datafile").is_some() {
        return Err(source.unsupported("NRRD headers with their voxels in other files are not read"));
    }
    for skip in ["lineskip", "byteskip"] {
        if fields.get(skip).is_some_and(|n| n != "0") {
            return Err(source.unsupported(&format!("the NRRD field {skip} is not supported")));
        }
    }

    let axes = Axes::read(&fields, &source)?;
    let affine = axes.affine(&fields, &source)?;
    let scalar = scalar(fields.need("type", &source)?, &source)?;
    let encoding = match fields.need("encoding", &source)?.to_ascii_lowercase().as_str() {
        "raw" => binary(scalar, &fields, &source)?,
        "gz" | "gzip" => {
            let encoding = binary(scalar, &fields, &source)?;
            source = source.inflated();
            encoding
        }
        "txt" | "text" | "ascii" => Encoding::Text,
        other => return Err(source.unsupported(&format!("the NRRD encoding {other} is not supported"))),
    };
    Volume::new(source, axes.dims, affine, encoding, None)
}

fn binary(scalar: Scalar, fields: &Fields, source: &Source) -> Result<Encoding> {
    let is_big_endian = match fields.get("endian") {
        Some("little") => false,
        Some("big") => true,
        // A single byte has no order.
        None if scalar.size() == 1 => false,
        None => return Err(source.refuse("the field 'endian' is missing")),
        Some(other) => return Err(source.refuse(format!("unknown byte order '{other}'"))),
    };
    Ok(Encoding::Binary { scalar, is_big_endian })
}

/// The fields of a header by name, in lower case and without spaces, since both `data file` and `datafile`
/// are in use.
struct Fields(BTreeMap<String, String>);

impl Fields {
    /// Reads the header up to and including its blank line.
    fn read(source: &mut Source) -> Result<Self> {
        let mut header = (&mut source.reader).take(LONGEST_HEADER);
        let mut fields = BTreeMap::new();
        let mut length = 0;
        let mut line = Vec::new();
        for number in 1.. {
            line.clear();
            length += header.read_until(b'\n', &mut line).map_err(|e| read_error(&source.what, e))?;
            if line.pop() != Some(b'\n') {
                return Err(source.refuse("the NRRD header has no end"));
            }
            let text = String::from_utf8_lossy(&line);
            let text = text.trim_end();
            if number == 1 {
                if !matches!(text, "NRRD0001" | "NRRD0002" | "NRRD0003" | "NRRD0004" | "NRRD0005") {
                    return Err(source.refuse("not a known version of NRRD"));
                }
            } else if text.is_empty() {
                break;
            } else if let Some((name, value)) = field(text) {
                if fields.insert(name.clone(), value.to_owned()).is_some() {
                    return Err(source.refuse(format!("the field '{name}' occurs twice")));
                }
            } else if !text.starts_with('#') && !text.contains(":=") {
                return Err(source.refuse(format!("line {number} of the NRRD header is not a field")));
            }
        }
        source.capacity = source.capacity.saturating_sub(length as u64);
        Ok(Self(fields))
    }

    fn get(&self, name: &str) -> Option<&str> {
        self.0.get(name).map(String::as_str)
    }

    fn need(&self, name: &str, source: &Source) -> Result<&str> {
        self.get(name).ok_or_else(|| source.refuse(format!("the field '{name}' is missing")))
    }
}

/// Name and value of a line such as `space origin: (0,0,0)`; comments and `key:=value` pairs are no fields.
fn field(line: &str) -> Option<(String, &str)> {
    let (name, value) = line.split_once(": ").or_else(|| line.strip_suffix(':').map(|name| (name, "")))?;
    if line.starts_with('#') || name.contains(":=") {
        return None;
    }
    Some((name.replace(' ', "").to_ascii_lowercase(), value.trim()))
}

/// The axes of the array.
struct Axes {
    /// Number of all axes.
    count: usize,
    /// Which three axes are spatial, fastest first.
    spatial: [usize; 3],
    /// Their lengths in voxels.
    dims: [usize; 3],
    /// Their directions, where given.
    directions: Option<[Vec3; 3]>,
}

impl Axes {
    fn read(fields: &Fields, source: &Source) -> Result<Self> {
        let count: usize = number(fields.need("dimension", source)?, "dimension", source)?;
        if !(1..=MOST_AXES).contains(&count) {
            return Err(source.refuse(format!("an array of {count} dimensions")));
        }
        let lengths: Vec<usize> = numbers(fields.need("sizes", source)?, count, "sizes", source)?;

        let directions = fields.get("spacedirections").map(|text| vectors(text, source)).transpose()?;
        let spatial: Vec<usize> = match &directions {
            Some(list) if list.len() == count => (0..count).filter(|&a| list[a].is_some()).collect(),
            Some(list) => {
                return Err(source.refuse(format!("{} space directions for {count} axes", list.len())));
            }
            None => (0..count.min(3)).collect(),
        };
        let not_a_volume =
            || source.unsupported(&format!("an array of {lengths:?} without exactly three spatial axes"));
        let spatial: [usize; 3] = spatial.try_into().map_err(|_| not_a_volume())?;
        if (0..count).any(|a| lengths[a] != 1 && !spatial.contains(&a)) {
            return Err(not_a_volume());
        }

        if let Some(kinds) = fields.get("kinds") {
            let kinds: Vec<&str> = kinds.split_whitespace().collect();
            if kinds.len() != count {
                return Err(source.refuse(format!("{} kinds for {count} axes", kinds.len())));
            }
            if let Some(&axis) =
                spatial.iter().find(|&&a| !matches!(kinds[a], "domain" | "space" | "none" | "???"))
            {
                return Err(
                    source.unsupported(&format!("axis {axis} of kind {} is not spatial", kinds[axis]))
                );
            }
        }
        Ok(Self {
            count,
            spatial,
            dims: spatial.map(|a| lengths[a]),
            directions: directions.map(|list| spatial.map(|a| list[a].unwrap_or_default())),
        })
    }

    /// Voxel index to world, RAS, metres.
    fn affine(&self, fields: &Fields, source: &Source) -> Result<Affine> {
        let signs = match fields.get("space").map(str::to_ascii_lowercase).as_deref() {
            None | Some("right-anterior-superior" | "ras" | "3d-right-handed") => Vec3::new(1.0, 1.0, 1.0),
            Some("left-posterior-superior" | "lps") => Vec3::new(-1.0, -1.0, 1.0),
            Some("left-anterior-superior" | "las") => Vec3::new(-1.0, 1.0, 1.0),
            Some(other) => return Err(source.unsupported(&format!("the space '{other}' is not supported"))),
        };
        let mut affine = Affine::zeros();
        let unit_m;
        if let Some(directions) = self.directions {
            unit_m = unit(fields.get("spaceunits"), &[0, 1, 2], source)?;
            affine.fixed_columns_mut::<3>(0).copy_from(&Mat3::from_columns(&directions));
            if let Some(origin) = fields.get("spaceorigin") {
                let [Some(origin)] = vectors(origin, source)?[..] else {
                    return Err(source.refuse("the space origin is not one vector"));
                };
                affine.set_column(3, &origin);
            }
        } else {
            if fields.get("axismins").is_some() || fields.get("axismaxs").is_some() {
                return Err(source.unsupported("axis mins and maxs are not supported; use space directions"));
            }
            unit_m = unit(fields.get("units"), &self.spatial, source)?;
            let spacings: Vec<f64> =
                numbers(fields.need("spacings", source)?, self.count, "spacings", source)?;
            let spacings = Vec3::from(self.spatial.map(|a| spacings[a]));
            affine.fixed_columns_mut::<3>(0).copy_from(&Mat3::from_diagonal(&spacings));
        }
        Ok(Affine::from_fn(|r, c| signs[r] * affine[(r, c)]) * unit_m)
    }
}

/// The length in metres of the unit that `axes` share, from a list of quoted names.
fn unit(text: Option<&str>, axes: &[usize; 3], source: &Source) -> Result<f64> {
    let Some(text) = text else { return Ok(1e-3) };
    let names: Vec<&str> = text.split('"').skip(1).step_by(2).collect();
    let name = names.get(axes[0]).copied().unwrap_or_default();
    if axes.iter().any(|&a| names.get(a) != Some(&name)) {
        return Err(source.refuse(format!("the axes have no common unit in {text}")));
    }
    match name {
        "" | "mm" | "millimeter" | "millimeters" | "millimetre" => Ok(1e-3),
        "m" | "meter" | "meters" | "metre" => Ok(1.0),
        "cm" => Ok(1e-2),
        "um" | "µm" | "μm" | "micron" | "microns" => Ok(1e-6),
        other => Err(source.unsupported(&format!("the unit of length '{other}' is not known"))),
    }
}

fn number<T: std::str::FromStr>(text: &str, field: &str, source: &Source) -> Result<T> {
    text.parse().map_err(|_| source.refuse(format!("'{text}' is not a number for '{field}'")))
}

fn numbers<T: std::str::FromStr>(text: &str, count: usize, field: &str, source: &Source) -> Result<Vec<T>> {
    let list: Vec<T> = text.split_whitespace().map(|t| number(t, field, source)).collect::<Result<_>>()?;
    if list.len() != count {
        return Err(source.refuse(format!("{} numbers for '{field}' of {count} axes", list.len())));
    }
    Ok(list)
}

/// Vectors such as `(1,0,0) none (0,1,0)`.
fn vectors(text: &str, source: &Source) -> Result<Vec<Option<Vec3>>> {
    let mut list = Vec::new();
    let mut rest = text.trim_start();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            list.push(None);
            rest = after.trim_start();
            continue;
        }
        let inside = rest.strip_prefix('(').and_then(|r| r.split_once(')'));
        let (inside, after) =
            inside.ok_or_else(|| source.refuse(format!("'{text}' is not a list of vectors")))?;
        let parts: Vec<f64> =
            inside.split(',').map(|part| number(part.trim(), "a vector", source)).collect::<Result<_>>()?;
        let [x, y, z] = parts[..] else {
            return Err(source.unsupported(&format!("the vector ({inside}) is not three-dimensional")));
        };
        list.push(Some(Vec3::new(x, y, z)));
        rest = after.trim_start();
    }
    Ok(list)
}

fn scalar(name: &str, source: &Source) -> Result<Scalar> {
    // `unsigned short int`, `ushort`, `uint16` and `uint16_t` are the same type.
    let words: Vec<&str> = name.split_whitespace().collect();
    Ok(match words.join(" ").as_str() {
        "signed char" | "int8" | "int8_t" => Scalar::I8,
        "unsigned char" | "uchar" | "uint8" | "uint8_t" => Scalar::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => Scalar::I16,
        "unsigned short" | "unsigned short int" | "ushort" | "uint16" | "uint16_t" => Scalar::U16,
        "int" | "signed int" | "int32" | "int32_t" => Scalar::I32,
        "unsigned int" | "uint" | "uint32" | "uint32_t" => Scalar::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => Scalar::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => Scalar::U64,
        "float" => Scalar::F32,
        "double" => Scalar::F64,
        other => return Err(source.unsupported(&format!("voxels of type '{other}' are not supported"))),
    })
}
