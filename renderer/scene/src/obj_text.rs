//! Looks over the text of OBJ files before they are parsed.

use std::borrow::Cow;
use std::collections::BTreeSet;

use glam::{DVec3, Vec3};

use super::place::far_middle;

/// An OBJ text that is safe to parse.
pub(super) struct Checked {
    /// The text without ignored statements. Where there are normals, the first is zero and stands for none.
    pub(super) text: String,
    /// Points, lines, curves and faces of fewer than three corners that were taken out.
    pub(super) ignored: usize,
    /// Faces that are left.
    pub(super) faces: usize,
    /// Corners that name texture coordinates or normals which are not there.
    pub(super) astray: usize,
    /// Vertices with colours, which are not used.
    pub(super) coloured: usize,
    /// The names of materials that faces have.
    pub(super) materials: BTreeSet<String>,
    /// The offset that was subtracted from all positions, because they lie far from the origin.
    pub(super) origin: Option<DVec3>,
}

/// The counts of each kind of vertex data.
#[derive(Clone, Copy, Default)]
struct Counts {
    positions: usize,
    texture: usize,
    normals: usize,
}

impl Counts {
    fn count(&mut self, keyword: &str) {
        match keyword {
            "v" => self.positions += 1,
            "vt" => self.texture += 1,
            "vn" => self.normals += 1,
            _ => {}
        }
    }
}

/// Keywords that names follow.
const NAMED: [&str; 11] =
    ["usemtl", "mtllib", "o", "g", "newmtl", "map_Kd", "map_d", "map_Ke", "map_Pr", "map_Pm", "norm"];

/// The statements of a text without comments, each with the number of the line it begins in. A line that ends
/// in a backslash goes on in the next; a comment does not. A comment may stand behind numbers, but a name may
/// hold its sign.
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

/// Checks numbers and faces, and takes out statements that make no triangle; also texture coordinates, unless
/// `with_textures`. Then every corner has some: those without get (0, 0), which stands before all others. The
/// text begins by naming `libraries` libraries of materials, by their numbers.
///
/// # Errors
/// One sentence that names the line and its fault.
pub(super) fn check(text: &str, with_textures: bool, libraries: usize) -> Result<Checked, String> {
    let mut total = Counts::default();
    for (_, statement) in statements(text) {
        total.count(keyword_and_rest(&statement).0);
    }
    let position = |statement: &str| match keyword_and_rest(statement) {
        ("v", rest) => doubles(rest),
        _ => None,
    };
    let mut checked = Checked {
        text: String::with_capacity(text.len()),
        ignored: 0,
        faces: 0,
        astray: 0,
        coloured: 0,
        materials: BTreeSet::new(),
        origin: far_middle(statements(text).filter_map(|(_, statement)| position(&statement))),
    };
    (0..libraries).for_each(|number| push_line(&mut checked.text, &format!("mtllib {number}")));
    if with_textures {
        push_line(&mut checked.text, "vt 0 0");
    }
    if total.normals > 0 {
        push_line(&mut checked.text, "vn 0 0 0");
    }
    let mut so_far = Counts::default();
    for (number, statement) in statements(text) {
        so_far.count(keyword_and_rest(&statement).0);
        let corners = Corners { so_far, total, with_textures };
        checked.add(&statement, &corners).map_err(|what| format!("line {number}: {what}"))?;
    }
    Ok(checked)
}

impl Checked {
    /// Adds a statement, unless it is ignored.
    fn add(&mut self, statement: &str, corners: &Corners) -> Result<(), String> {
        let (keyword, rest) = keyword_and_rest(statement);
        let words = || rest.split_whitespace();
        match keyword {
            "v" | "vn" => {
                let found: Vec<&str> = words().take(3).filter(|word| word.parse::<f32>().is_ok()).collect();
                if found.len() < 3 {
                    return Err(format!("\"{}\" does not have three numbers", shortened(statement)));
                }
                // Colours and weights behind the position are not used; some exporters write them badly.
                self.coloured += usize::from(keyword == "v" && words().count() >= 6);
                match (self.origin, doubles(rest)) {
                    (Some(origin), Some(at)) if keyword == "v" => {
                        let Vec3 { x, y, z } = (at - origin).as_vec3();
                        push_line(&mut self.text, &format!("v {x} {y} {z}"));
                    }
                    _ => push_line(&mut self.text, &format!("{keyword} {}", found.join(" "))),
                }
            }
            "vt" if corners.with_textures => {
                let mut numbers =
                    words().map(|word| word.parse::<f32>().ok().filter(|number| number.is_finite()));
                let mut number = || numbers.next().flatten().unwrap_or(0.0);
                push_line(&mut self.text, &format!("vt {} {}", number(), number()));
            }
            // `fo` is what faces were called before version 3.0.
            "f" | "fo" => {
                let read = |word| corners.read(word, &mut self.astray);
                let found: Vec<String> = words().map(read).collect::<Result<_, _>>()?;
                if found.len() < 3 {
                    self.ignored += 1;
                } else {
                    self.faces += 1;
                    push_line(&mut self.text, &format!("f {}", found.join(" ")));
                }
            }
            "p" | "l" | "curv" | "curv2" | "surf" => self.ignored += 1,
            "usemtl" if !rest.is_empty() => {
                self.materials.insert(rest.to_owned());
                push_line(&mut self.text, &format!("usemtl {rest}"));
            }
            "o" | "g" => push_line(&mut self.text, &format!("{keyword} {rest}")),
            _ => {}
        }
        Ok(())
    }
}

/// The first three numbers of a statement.
fn doubles(rest: &str) -> Option<DVec3> {
    let mut numbers = rest.split_whitespace().map(|word| word.parse::<f64>());
    let mut number = || numbers.next()?.ok();
    Some(DVec3::new(number()?, number()?, number()?))
}

fn push_line(text: &mut String, line: &str) {
    text.push_str(line);
    text.push('\n');
}

fn shortened(line: &str) -> String {
    line.trim().chars().take(60).collect()
}

/// The meaning of corner numbers at the place of a face.
struct Corners {
    so_far: Counts,
    total: Counts,
    with_textures: bool,
}

impl Corners {
    /// A corner `position/texture/normal` with absolute numbers: that of the texture coordinates one higher
    /// or left out, that of the normal one higher. Zero, and a number of what the file does not have, counts
    /// as none.
    fn read(&self, word: &str, astray: &mut usize) -> Result<String, String> {
        let mut numbers = word.split('/');
        let position = match numbers.next() {
            None | Some("") => {
                return Err(format!("the face's corner \"{}\" names no vertex", shortened(word)));
            }
            Some(text) => absolute(text, self.so_far.positions)?,
        };
        if !(1..=self.total.positions as i64).contains(&position) {
            let text = word.split('/').next().unwrap_or("");
            return Err(format!("the face names vertex {text}, but there are only {}", self.total.positions));
        }
        let mut known = true;
        let mut next = |so_far: usize, total: usize| match numbers.next() {
            None | Some("") => Ok(0),
            Some(text) => {
                let number = absolute(text, so_far)?;
                let found = (1..=total as i64).contains(&number);
                known &= found;
                Ok::<i64, String>(if found { number } else { 0 })
            }
        };
        let texture = next(self.so_far.texture, self.total.texture)?;
        let normal = next(self.so_far.normals, self.total.normals)?;
        *astray += usize::from(!known);
        let texture = if self.with_textures { (texture + 1).to_string() } else { String::new() };
        Ok(match self.total.normals {
            0 if self.with_textures => format!("{position}/{texture}"),
            0 => position.to_string(),
            _ => format!("{position}/{texture}/{}", normal + 1),
        })
    }
}

/// A one-based number that may count back from the latest, as a number from the start.
fn absolute(text: &str, so_far: usize) -> Result<i64, String> {
    let number: i64 =
        text.parse().map_err(|_| format!("the face's number \"{}\" is no number", shortened(text)))?;
    Ok(if number < 0 { so_far as i64 + 1 + number } else { number })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(text: &str, with_textures: bool) -> Checked {
        check(text, with_textures, 0).unwrap()
    }

    #[test]
    fn relative_numbers_count_from_where_they_stand() {
        let found = checked("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf -3//-1 -2//1 -1//1\nv 5 5 5\n", false);
        assert!(found.text.ends_with("f 1//2 2//2 3//2\nv 5 5 5\n"), "{}", found.text);
        // A number may point forward.
        assert_eq!(checked("f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n", false).faces, 1);
    }

    #[test]
    fn numbers_of_what_is_not_there_count_as_none() {
        let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        let found = checked(&format!("{corners}f 1/1/1 2/-1 3/0\n"), false);
        assert_eq!((found.text.ends_with("f 1 2 3\n"), found.astray), (true, 3));
        let found = checked(&format!("{corners}vn 0 0 1\nvt 1 1\nf 1/1/0 2/2/1 3//1\n"), true);
        assert_eq!(
            (found.text.ends_with("f 1/2/1 2/1/2 3/1/2\n"), found.astray),
            (true, 2),
            "{}",
            found.text
        );
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
            let message = check(text, false, 0).err().unwrap();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn lines_and_points_are_taken_out_and_counted() {
        let found = checked("v 0 0 0\np 1\nl 1 1 1\nf 1 1\nusemtl \nf 1 1 \\\n 1\n", false);
        assert_eq!((found.ignored, found.faces), (3, 1));
        assert_eq!(found.text, "v 0 0 0\nf 1 1 1\n");
    }

    #[test]
    fn comments_end_numbers_and_never_go_on() {
        let text =
            "# of C:\\models\\\nv 0 0 0#first\nv 1 0 0 # \\\nv 0 1 0\nusemtl a #2\nf 1 \\ \n2 3 # one\n";
        let found = check(text, false, 2).unwrap();
        let expected = "mtllib 0\nmtllib 1\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a #2\nf 1 2 3\n";
        assert_eq!(found.text, expected);
        assert!(found.materials.contains("a #2"));
    }

    #[test]
    fn corners_without_texture_coordinates_get_some() {
        let text = "v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvt 0.5 1\nvt nan x\nf 1/1 2/-1/1 3\n";
        let found = checked(text, true);
        assert_eq!(found.coloured, 1);
        assert!(found.text.starts_with("vt 0 0\nvn 0 0 0\n"), "{}", found.text);
        assert!(found.text.contains("vt 0.5 1\nvt 0 0\n") && found.text.ends_with("f 1/2/1 2/3/2 3/1/1\n"));
        let without = checked(text, false).text;
        assert!(!without.contains("vt") && without.ends_with("f 1//1 2//2 3//1\n"), "{without}");
    }
}
