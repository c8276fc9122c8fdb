//! PLY, text and binary.
//!
//! Vertices have x, y, z and may have texture coordinates (`s t`, `u v` or `texture_u texture_v`); faces have
//! `vertex_indices` or `vertex_index`. Other properties and elements are passed over.

use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};

use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::model::mesh::TriangleMesh;

/// Longest message of the parser that is passed on: it quotes whole lines.
const LONGEST_QUOTE: usize = 200;

pub(super) fn parse(what: &str, bytes: &[u8]) -> Result<TriangleMesh> {
    let refuse = |reason: String| Error::format(what, reason.chars().take(LONGEST_QUOTE).collect::<String>());
    let parser = Parser::<Item>::new();
    let mut reader = Reader::new(bytes);
    let header = parser.read_header(&mut reader).map_err(|e| refuse(e.to_string()))?;
    let body = reader.get_ref().len();
    check_header(&header, &bytes[..bytes.len() - body], body).map_err(refuse)?;

    let mut mesh = TriangleMesh::default();
    for (name, element) in &header.elements {
        let items = parser.read_payload_for_element(&mut reader, element, &header);
        let items = items.map_err(|e| refuse(e.to_string()))?;
        match name.as_str() {
            "vertex" => {
                mesh.positions = items.iter().map(|item| item.position).collect();
                if UV_NAMES.iter().any(|uv| uv.iter().all(|n| element.properties.contains_key(*n))) {
                    mesh.uvs = items.iter().map(|item| item.uv).collect();
                }
            }
            "face" => {
                for item in &items {
                    add_fan(&item.corners, &mut mesh.triangles).map_err(refuse)?;
                }
            }
            _ => {}
        }
    }
    if !reader.get_ref().trim_ascii().is_empty() {
        return Err(refuse("more data follows than the header promises".into()));
    }
    Ok(mesh)
}

/// Refuses counts that the rest of the file cannot hold, and what the parser would pass over in silence.
fn check_header(header: &Header, text: &[u8], body: usize) -> Result<(), String> {
    let mut least = 0_usize;
    for (name, element) in &header.elements {
        let bytes = least_bytes(element, header.encoding);
        if bytes == 0 && element.count > 0 {
            return Err(format!("the element '{name}' has no properties"));
        }
        least = element.count.checked_mul(bytes).and_then(|n| n.checked_add(least)).unwrap_or(usize::MAX);
    }
    // The last line of a text needs no line break.
    if least > body + 1 {
        return Err(format!("the header promises at least {least} bytes, but {body} follow"));
    }

    // Of two elements or properties with one name the parser keeps the last.
    let lines =
        |keyword: &[u8]| text.split(|&b| b == b'\n').filter(|l| l.trim_ascii().starts_with(keyword)).count();
    let properties: usize = header.elements.values().map(|e| e.properties.len()).sum();
    if lines(b"element ") > header.elements.len() || lines(b"property ") > properties {
        return Err("two elements or properties have the same name".into());
    }

    let vertex = header.elements.get("vertex").ok_or("there are no vertices")?;
    for axis in ["x", "y", "z"] {
        if !vertex.properties.get(axis).is_some_and(|p| matches!(p.data_type, PropertyType::Scalar(_))) {
            return Err(format!("vertices have no {axis}"));
        }
    }
    Ok(())
}

/// The fewest bytes that one item of an element takes.
fn least_bytes(element: &ElementDef, encoding: Encoding) -> usize {
    match encoding {
        // A digit and a space or line break.
        Encoding::Ascii => 2 * element.properties.len(),
        Encoding::BinaryBigEndian | Encoding::BinaryLittleEndian => element
            .properties
            .values()
            .map(|property| match &property.data_type {
                PropertyType::Scalar(scalar) | PropertyType::List(scalar, _) => size(scalar),
            })
            .sum(),
    }
}

fn size(scalar: &ScalarType) -> usize {
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

fn add_fan(corners: &[i64], triangles: &mut Vec<[u32; 3]>) -> Result<(), String> {
    let corners: Vec<u32> = corners
        .iter()
        .map(|&c| u32::try_from(c).map_err(|_| format!("a face names vertex {c}")))
        .collect::<Result<_, _>>()?;
    if corners.len() < 3 {
        return Err(format!("a face of {} corners", corners.len()));
    }
    triangles.extend(corners[1..].windows(2).map(|edge| [corners[0], edge[0], edge[1]]));
    Ok(())
}

/// Names in use for the two texture coordinates of a vertex.
const UV_NAMES: [[&str; 2]; 3] = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"]];

/// One vertex, face or anything else: what a mesh takes from it.
struct Item {
    position: Vec3,
    uv: [f32; 2],
    corners: Vec<i64>,
}

impl PropertyAccess for Item {
    fn new() -> Self {
        Self { position: Vec3::zeros(), uv: [0.0; 2], corners: Vec::new() }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        match name {
            "x" => self.position.x = scalar(&property),
            "y" => self.position.y = scalar(&property),
            "z" => self.position.z = scalar(&property),
            "s" | "u" | "texture_u" => self.uv[0] = scalar(&property) as f32,
            "t" | "v" | "texture_v" => self.uv[1] = scalar(&property) as f32,
            "vertex_index" | "vertex_indices" => match indices(property) {
                Some(corners) => self.corners = corners,
                None => return PropertyAccessResult::UnsupportedType,
            },
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

/// A number; not one where the property is a list.
fn scalar(property: &Property) -> f64 {
    match *property {
        Property::Char(v) => f64::from(v),
        Property::UChar(v) => f64::from(v),
        Property::Short(v) => f64::from(v),
        Property::UShort(v) => f64::from(v),
        Property::Int(v) => f64::from(v),
        Property::UInt(v) => f64::from(v),
        Property::Float(v) => f64::from(v),
        Property::Double(v) => v,
        _ => f64::NAN,
    }
}

/// A list of whole numbers.
fn indices(property: Property) -> Option<Vec<i64>> {
    Some(match property {
        Property::ListChar(v) => v.into_iter().map(i64::from).collect(),
        Property::ListUChar(v) => v.into_iter().map(i64::from).collect(),
        Property::ListShort(v) => v.into_iter().map(i64::from).collect(),
        Property::ListUShort(v) => v.into_iter().map(i64::from).collect(),
        Property::ListInt(v) => v.into_iter().map(i64::from).collect(),
        Property::ListUInt(v) => v.into_iter().map(i64::from).collect(),
        _ => return None,
    })
}
