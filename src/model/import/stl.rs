//! STL, text and binary.
//!
//! A file whose length is exactly what its binary triangle count asks for is binary, even if it starts with
//! "solid", as some writers have it. A text may hold several solids; they become one mesh.

use std::collections::HashMap;
use std::io::Cursor;

use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::model::mesh::TriangleMesh;

/// Bytes before the triangles of a binary file: a comment and the triangle count.
const HEADER: usize = 84;
/// Bytes of a triangle: normal, three vertices and an attribute.
const TRIANGLE: usize = 50;

pub(super) fn parse(what: &str, bytes: &[u8]) -> Result<TriangleMesh> {
    let mut welder = Welder::default();
    if is_binary(bytes) {
        // stl_io takes whatever starts with "solid " for text, so the comment of such a file is blanked.
        if bytes.starts_with(b"solid") {
            welder.add_solid(what, &[&[0; 5], &bytes[5..]].concat())?;
        } else {
            welder.add_solid(what, bytes)?;
        }
        return Ok(welder.mesh);
    }

    let is_text = bytes.trim_ascii_start().starts_with(b"solid");
    let text = str::from_utf8(bytes).ok().filter(|_| is_text).ok_or_else(|| {
        Error::format(
            what,
            "neither a text STL nor a binary one of the length that its triangle count asks for",
        )
    })?;
    // stl_io reads one solid and wants it named.
    let mut solid = String::new();
    for line in text.lines() {
        let words = line.trim();
        match words.split_whitespace().next() {
            Some("solid") if solid.is_empty() => solid.push_str("solid _"),
            Some(_) => solid.push_str(words),
            None => continue,
        }
        solid.push('\n');
        if words.starts_with("endsolid") {
            welder.add_solid(what, solid.as_bytes())?;
            solid.clear();
        }
    }
    if !solid.is_empty() {
        return Err(Error::format(what, "the file ends too early"));
    }
    Ok(welder.mesh)
}

fn is_binary(bytes: &[u8]) -> bool {
    bytes[..HEADER.min(bytes.len())].last_chunk::<4>().is_some_and(|&count| {
        bytes.len() as u64 == HEADER as u64 + u64::from(u32::from_le_bytes(count)) * TRIANGLE as u64
    })
}

/// Makes one vertex of equal positions.
#[derive(Default)]
struct Welder {
    mesh: TriangleMesh,
    vertex_at: HashMap<[u32; 3], u32>,
}

impl Welder {
    fn add_solid(&mut self, what: &str, bytes: &[u8]) -> Result<()> {
        let damaged = |e: std::io::Error| Error::format(what, format!("damaged STL: {e}"));
        let mut cursor = Cursor::new(bytes);
        for triangle in stl_io::create_stl_reader(&mut cursor).map_err(damaged)? {
            let triangle = triangle.map_err(damaged)?;
            let mut corners = [0; 3];
            for (corner, vertex) in corners.iter_mut().zip(triangle.vertices) {
                *corner = self
                    .vertex(vertex.0)
                    .ok_or_else(|| Error::Limit(format!("{what}: more vertices than a mesh may have")))?;
            }
            self.mesh.triangles.push(corners);
        }
        Ok(())
    }

    fn vertex(&mut self, position: [f32; 3]) -> Option<u32> {
        // Adding 0 makes −0 equal to 0.
        let key = position.map(|x| (x + 0.0).to_bits());
        let next = u32::try_from(self.mesh.positions.len()).ok()?;
        Some(*self.vertex_at.entry(key).or_insert_with(|| {
            self.mesh.positions.push(Vec3::from(position.map(f64::from)));
            next
        }))
    }
}
