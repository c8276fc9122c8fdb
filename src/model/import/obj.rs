//! Wavefront OBJ: vertices, texture coordinates and polygons. Materials, groups, normals, lines and curves
//! are passed over.

use std::collections::HashMap;

use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::model::mesh::TriangleMesh;

pub(super) fn parse(what: &str, bytes: &[u8]) -> Result<TriangleMesh> {
    let text = String::from_utf8_lossy(bytes);
    let mut reader = Reader::default();
    for (number, line) in text.lines().enumerate() {
        reader
            .read_line(line)
            .map_err(|reason| Error::format(what, format!("line {}: {reason}", number + 1)))?;
    }
    reader.into_mesh().map_err(|reason| Error::format(what, reason))
}

/// A corner of a polygon: vertex and, where given, texture coordinate, both counted from 0.
type Corner = (u32, Option<u32>);

#[derive(Default)]
struct Reader {
    positions: Vec<Vec3>,
    uvs: Vec<[f32; 2]>,
    triangles: Vec<[Corner; 3]>,
}

impl Reader {
    fn read_line(&mut self, line: &str) -> Result<(), String> {
        let mut words = line.split_whitespace();
        match words.next() {
            // A weight or a colour may follow the three coordinates; neither moves the vertex.
            Some("v") => self.positions.push(Vec3::from(floats::<3>(words)?)),
            Some("vt") => self.uvs.push(floats::<2>(words)?.map(|x| x as f32)),
            Some("f") => {
                let corners: Vec<Corner> = words.map(|w| self.corner(w)).collect::<Result<_, _>>()?;
                if corners.len() < 3 {
                    return Err(format!("a face of {} corners", corners.len()));
                }
                let fan = corners[1..].windows(2).map(|edge| [corners[0], edge[0], edge[1]]);
                self.triangles.extend(fan);
            }
            Some(_) | None => {}
        }
        Ok(())
    }

    /// `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn corner(&self, word: &str) -> Result<Corner, String> {
        let mut parts = word.split('/');
        let vertex = index(parts.next().unwrap_or_default(), self.positions.len())?;
        let uv = match parts.next() {
            None | Some("") => None,
            Some(part) => Some(index(part, self.uvs.len())?),
        };
        if parts.count() > 1 {
            return Err(format!("'{word}' has too many parts"));
        }
        Ok((vertex, uv))
    }

    fn into_mesh(self) -> Result<TriangleMesh, String> {
        // Faces may name what only a later line defines, so ranges are checked at the end.
        for &(vertex, uv) in self.triangles.iter().flatten() {
            if vertex as usize >= self.positions.len() {
                return Err(format!(
                    "a face names vertex {} of {}",
                    u64::from(vertex) + 1,
                    self.positions.len()
                ));
            }
            if let Some(uv) = uv.filter(|&uv| uv as usize >= self.uvs.len()) {
                return Err(format!(
                    "a face names texture coordinate {} of {}",
                    u64::from(uv) + 1,
                    self.uvs.len()
                ));
            }
        }
        let is_textured = self.triangles.iter().flatten().any(|&(_, uv)| uv.is_some());
        if !is_textured {
            let triangles = self.triangles.iter().map(|t| t.map(|(vertex, _)| vertex)).collect();
            return Ok(TriangleMesh { positions: self.positions, triangles, uvs: Vec::new() });
        }
        self.split_at_seams()
    }

    /// Gives every vertex one texture coordinate, (0, 0) where the file has none, and repeats vertices that
    /// have several.
    fn split_at_seams(mut self) -> Result<TriangleMesh, String> {
        let mut uv_of: Vec<Option<u32>> = vec![None; self.positions.len()];
        let mut repeated: HashMap<(u32, u32), u32> = HashMap::new();
        let mut triangles = Vec::with_capacity(self.triangles.len());
        for corners in &self.triangles {
            let mut triangle = [0; 3];
            for (place, &(vertex, uv)) in triangle.iter_mut().zip(corners) {
                let owner = &mut uv_of[vertex as usize];
                *place = match uv {
                    Some(uv) if *owner.get_or_insert(uv) != uv => {
                        let next = u32::try_from(self.positions.len()).map_err(|_| "too many vertices")?;
                        *repeated.entry((vertex, uv)).or_insert_with(|| {
                            self.positions.push(self.positions[vertex as usize]);
                            uv_of.push(Some(uv));
                            next
                        })
                    }
                    Some(_) | None => vertex,
                };
            }
            triangles.push(triangle);
        }
        let uvs = uv_of.iter().map(|uv| uv.map_or([0.0; 2], |uv| self.uvs[uv as usize])).collect();
        Ok(TriangleMesh { positions: self.positions, triangles, uvs })
    }
}

fn floats<'a, const N: usize>(mut words: impl Iterator<Item = &'a str>) -> Result<[f64; N], String> {
    let mut values = [0.0; N];
    for value in &mut values {
        let word = words.next().ok_or("a number is missing")?;
        *value = word.parse().map_err(|_| format!("'{word}' is not a number"))?;
    }
    Ok(values)
}

/// An index counted from 1, or backwards from the `count` things defined so far when negative, as one counted
/// from 0.
fn index(word: &str, count: usize) -> Result<u32, String> {
    let written: i64 = word.parse().map_err(|_| format!("'{word}' is not an index"))?;
    let index = if written < 0 { (count as i64).checked_add(written) } else { written.checked_sub(1) };
    index.and_then(|i| u32::try_from(i).ok()).ok_or_else(|| format!("index {written} is out of range"))
}
