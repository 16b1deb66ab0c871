//! Reads the text of OBJ files.

use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap};

use glam::{DVec3, Vec2, Vec3};

use super::{part::Part, place::far_middle};

#[derive(Default)]
pub(super) struct Parsed {
    /// Those with faces, in order.
    pub(super) groups: Vec<Group>,
    /// Points, lines, curves and faces of fewer than three corners, which are left out.
    pub(super) ignored: usize,
    /// Corners that name texture coordinates or normals which are not there.
    pub(super) astray: usize,
    /// Vertices with colours, which are not used.
    pub(super) coloured: usize,
    /// The names of materials that there are not.
    pub(super) unknown: BTreeSet<String>,
    /// The offset that was subtracted from all positions, because they lie far from the origin.
    pub(super) origin: Option<DVec3>,
}

/// Faces of one name and material that follow each other.
#[derive(Default)]
pub(super) struct Group {
    pub(super) name: String,
    /// The number of its material, if that is there.
    pub(super) material: Option<usize>,
    pub(super) part: Part,
}

/// The name of a group without one.
const UNNAMED: &str = "unnamed_object";

/// Keywords that names follow.
const NAMED: [&str; 11] =
    ["usemtl", "mtllib", "o", "g", "newmtl", "map_Kd", "map_d", "map_Ke", "map_Pr", "map_Pm", "norm"];

/// The statements of a text with their line numbers, without comments. A backslash goes on in the next line,
/// except in a comment. A name may hold a comment's sign; numbers end at it.
pub(super) fn statements(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut lines = (1..).zip(text.split('\n'));
    std::iter::from_fn(move || {
        let (number, line) = lines.next()?;
        let has_name = NAMED.contains(&keyword_and_rest(line.trim()).0);
        let without =
            |line: &'_ str| if has_name { line.len() } else { line.find('#').unwrap_or(line.len()) };
        let mut whole = Cow::Borrowed(line[..without(line)].trim());
        while let Some(part) = whole.strip_suffix('\\') {
            let following = lines.next().map_or("", |(_, line)| &line[..without(line)]);
            whole = Cow::Owned(format!("{part} {}", following.trim()));
        }
        Some((number, whole))
    })
}

/// The keyword of a statement and what follows it.
pub(super) fn keyword_and_rest(statement: &str) -> (&str, &str) {
    let (keyword, rest) = statement.split_once(char::is_whitespace).unwrap_or((statement, ""));
    (keyword, rest.trim())
}

/// Reads a text whose materials have these numbers. `with_textures`, every corner has texture coordinates,
/// and where there are normals, every corner of a group that uses any has one, which may be zero.
///
/// # Errors
/// One sentence that names the line and its fault.
pub(super) fn parse(
    text: &str,
    with_textures: bool,
    materials: &HashMap<&str, usize>,
) -> Result<Parsed, String> {
    let vertices = VertexData::read(text)?;
    let origin = far_middle(vertices.positions.iter().skip(1).copied());
    let mut faces = Faces {
        with_textures,
        materials,
        so_far: [0; 3],
        open: Group { name: UNNAMED.to_owned(), ..Group::default() },
        numbers: HashMap::new(),
        parsed: Parsed { coloured: vertices.coloured, origin, ..Parsed::default() },
        vertices,
    };
    for (number, statement) in statements(text) {
        faces.add(&statement).map_err(|what| format!("line {number}: {what}"))?;
    }
    faces.begin(String::new(), None);
    Ok(faces.parsed)
}

/// The data of vertices by their numbers in the text, from 1. What has number 0 stands for none.
struct VertexData {
    positions: Vec<DVec3>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
    /// Vertices with colours.
    coloured: usize,
}

impl VertexData {
    fn read(text: &str) -> Result<Self, String> {
        let mut data =
            Self { positions: vec![DVec3::NAN], uvs: vec![Vec2::Y], normals: vec![Vec3::ZERO], coloured: 0 };
        for (number, statement) in statements(text) {
            let (keyword, rest) = keyword_and_rest(&statement);
            match keyword {
                "v" | "vn" => {
                    let Some(at) = doubles(rest) else {
                        let statement = shortened(&statement);
                        return Err(format!("line {number}: \"{statement}\" does not have three numbers"));
                    };
                    if keyword == "vn" {
                        data.normals.push(at.as_vec3());
                        continue;
                    }
                    data.positions.push(at);
                    // Colours and weights behind the position are not used; some exporters write them badly.
                    data.coloured += usize::from(rest.split_whitespace().count() >= 6);
                }
                "vt" => {
                    let finite = |word: &str| word.parse::<f32>().ok().filter(|number| number.is_finite());
                    let mut numbers = rest.split_whitespace().map(finite);
                    let mut number = || numbers.next().flatten().unwrap_or(0.0);
                    // Pictures stand upside down.
                    data.uvs.push(Vec2::new(number(), 1.0 - number()));
                }
                _ => {}
            }
        }
        Ok(data)
    }
}

/// Reads faces, after all data of vertices: numbers may point forward.
struct Faces<'a> {
    vertices: VertexData,
    with_textures: bool,
    materials: &'a HashMap<&'a str, usize>,
    /// Counts of positions, texture coordinates and normals up to the statement.
    so_far: [usize; 3],
    open: Group,
    /// The vertices of the open group, by the numbers of their data.
    numbers: HashMap<[usize; 3], u32>,
    parsed: Parsed,
}

impl Faces<'_> {
    fn add(&mut self, statement: &str) -> Result<(), String> {
        let (keyword, rest) = keyword_and_rest(statement);
        match keyword {
            "v" => self.so_far[0] += 1,
            "vt" => self.so_far[1] += 1,
            "vn" => self.so_far[2] += 1,
            // `fo` is what faces were called before version 3.0.
            "f" | "fo" => {
                let corners = rest.split_whitespace().map(|word| self.corner(word));
                let corners = corners.collect::<Result<Vec<_>, _>>()?;
                if corners.len() < 3 {
                    self.parsed.ignored += 1;
                } else {
                    let corners: Vec<u32> = corners.into_iter().map(|corner| self.vertex(corner)).collect();
                    self.open.part.push_polygon(&corners);
                }
            }
            "p" | "l" | "curv" | "curv2" | "surf" => self.parsed.ignored += 1,
            "usemtl" if !rest.is_empty() => {
                let material = self.materials.get(rest).copied();
                if material.is_none() {
                    self.parsed.unknown.insert(rest.to_owned());
                }
                if material != self.open.material {
                    self.begin(self.open.name.clone(), material);
                }
            }
            "o" | "g" => {
                let name = if rest.is_empty() { UNNAMED } else { rest };
                self.begin(name.to_owned(), self.open.material);
            }
            _ => {}
        }
        Ok(())
    }

    /// Ends the open group and begins another one.
    fn begin(&mut self, name: String, material: Option<usize>) {
        let begun = Group { name, material, part: Part::default() };
        let mut ended = std::mem::replace(&mut self.open, begun);
        self.numbers = HashMap::new();
        if ended.part.normals.iter().all(|normal| *normal == Vec3::ZERO) {
            ended.part.normals.clear();
        }
        if !ended.part.indices.is_empty() {
            self.parsed.groups.push(ended);
        }
    }

    /// The numbers of a corner `position/texture/normal` from the start; what is not there is none.
    fn corner(&mut self, word: &str) -> Result<[usize; 3], String> {
        let VertexData { positions, uvs, normals, .. } = &self.vertices;
        let ends = [positions.len(), uvs.len(), normals.len()];
        let (mut corner, mut known) = ([0; 3], true);
        for (place, text) in word.split('/').take(3).enumerate().filter(|(_, text)| !text.is_empty()) {
            let number = text.parse::<i64>();
            let number =
                number.map_err(|_| format!("the face's number \"{}\" is no number", shortened(text)))?;
            // One below zero counts back from the latest.
            let from_start = if number < 0 { self.so_far[place] as i64 + 1 + number } else { number };
            if (1..ends[place] as i64).contains(&from_start) {
                corner[place] = from_start as usize;
            } else if place == 0 {
                let last = positions.len() - 1;
                return Err(format!("the face names vertex {text}, but there are only {last}"));
            } else {
                known = false;
            }
        }
        if corner[0] == 0 {
            return Err(format!("the face's corner \"{}\" names no vertex", shortened(word)));
        }
        self.parsed.astray += usize::from(!known);
        if !self.with_textures {
            corner[1] = 0;
        }
        Ok(corner)
    }

    /// The number of a corner's vertex in the open group.
    fn vertex(&mut self, corner: [usize; 3]) -> u32 {
        let part = &mut self.open.part;
        *self.numbers.entry(corner).or_insert_with(|| {
            let [position, uv, normal] = corner;
            let at = self.vertices.positions[position] - self.parsed.origin.unwrap_or(DVec3::ZERO);
            part.positions.push(at.as_vec3());
            if self.with_textures {
                part.uvs.push(self.vertices.uvs[uv]);
            }
            part.normals.push(self.vertices.normals[normal]);
            part.positions.len() as u32 - 1
        })
    }
}

/// The first three numbers of a statement.
fn doubles(rest: &str) -> Option<DVec3> {
    let mut numbers = rest.split_whitespace().map(|word| word.parse::<f64>());
    let mut number = || numbers.next()?.ok();
    Some(DVec3::new(number()?, number()?, number()?))
}

fn shortened(line: &str) -> String {
    line.trim().chars().take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str, with_textures: bool) -> Parsed {
        parse(text, with_textures, &HashMap::from([("a", 0), ("b", 1)])).unwrap()
    }

    const CORNERS: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

    #[test]
    fn numbers_of_what_is_not_there_count_as_none() {
        let found = parsed(&format!("{CORNERS}f 1/1/1 2/-1 3/0\n"), false);
        assert_eq!((found.groups[0].part.normals.len(), found.astray), (0, 3));
        let found = parsed(&format!("{CORNERS}vn 0 0 1\nvt 1 1\nf 1/1/0 2/2/1 3//1\n"), true);
        let part = &found.groups[0].part;
        assert_eq!((&part.normals[..], found.astray), (&[Vec3::ZERO, Vec3::Z, Vec3::Z][..], 2));
        assert_eq!(part.uvs, [Vec2::X, Vec2::Y, Vec2::Y]);
    }

    #[test]
    fn errors_name_the_line() {
        for (text, expected) in [
            ("v 0 0 0\nf 1 2 3\n", "line 2: the face names vertex 2, but there are only 1"),
            ("v 0 0\n", "line 1: \"v 0 0\" does not have three numbers"),
            ("v 0 0 zero\n", "line 1"),
            ("v 0 \\\n 0 0\nf 0 1 1\n", "line 3: the face names vertex 0"),
            ("v 0 0 0\nf 1 1 99999999999999999999\n", "no number"),
            ("v 0 0 0\nf / 1 1\n", "names no vertex"),
        ] {
            let message = parse(text, false, &HashMap::new()).err().unwrap();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn comments_end_numbers_and_never_go_on() {
        let text =
            "# of C:\\models\\\nv 0 0 0#first\nv 1 0 0 # \\\nv 0 1 0\nusemtl a #2\nf 1 \\ \n2 3 # one\n";
        let found = parsed(text, false);
        assert_eq!(found.groups[0].part.indices, [[0, 1, 2]]);
        assert!(found.unknown.contains("a #2"));
    }

    #[test]
    fn names_and_materials_begin_groups() {
        let face = "f 1 2 3\n";
        let text = format!(
            "{CORNERS}{face}usemtl a\n{face}o x\nusemtl b\nusemtl a\n{face}{face}usemtl z\ng\n{face}"
        );
        let found = parsed(&text, false);
        let groups = found.groups.iter().map(|one| (&one.name[..], one.material, one.part.indices.len()));
        let expected = [(UNNAMED, None, 1), (UNNAMED, Some(0), 1), ("x", Some(0), 2), (UNNAMED, None, 1)];
        assert_eq!(groups.collect::<Vec<_>>(), expected);
        assert_eq!(found.groups[2].part.positions.len(), 3, "equal corners are one vertex");
        // A number may point forward.
        assert_eq!(parsed(&format!("f 1 2 3\n{CORNERS}"), false).groups[0].part.indices, [[0, 1, 2]]);
    }

    #[test]
    fn corners_without_texture_coordinates_get_some() {
        let text = "v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvt 0.5 1\nvt nan x\nf 1/1 2/-1/1 3\n";
        let found = parsed(text, true);
        let part = &found.groups[0].part;
        assert_eq!(found.coloured, 1);
        assert_eq!(part.uvs, [Vec2::new(0.5, 0.0), Vec2::Y, Vec2::Y]);
        assert_eq!(part.normals, [Vec3::ZERO, Vec3::Z, Vec3::ZERO]);
        assert!(parsed(text, false).groups[0].part.uvs.is_empty());
    }
}
