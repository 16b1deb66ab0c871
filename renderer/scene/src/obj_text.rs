//! Looks over the text of OBJ and MTL files before they are parsed.

/// An OBJ text that is safe to parse.
pub(super) struct Checked {
    /// The text without what is ignored.
    pub(super) text: String,
    /// Points, lines, curves and faces of fewer than three corners that were taken out.
    pub(super) ignored: usize,
    /// Faces that are left.
    pub(super) faces: usize,
}

/// How many of each kind of vertex data there are.
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

/// Checks numbers and faces, and takes out what no triangle comes of; also texture coordinates, unless `with_textures`.
/// Then every corner has some: those without get (0, 0), which stands before all others.
///
/// # Errors
/// One sentence that names the line and what is wrong with it.
pub(super) fn check(text: &str, with_textures: bool) -> Result<Checked, String> {
    // A line that ends in a backslash goes on in the next.
    let text = text.replace("\\\r\n", " ").replace("\\\n", " ");
    let mut total = Counts::default();
    for line in text.lines() {
        total.count(line.split_whitespace().next().unwrap_or(""));
    }
    let mut checked = Checked { text: String::with_capacity(text.len()), ignored: 0, faces: 0 };
    if with_textures {
        push_line(&mut checked.text, "vt 0 0");
    }
    let mut so_far = Counts::default();
    for (number, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        let keyword = words.next().unwrap_or("");
        so_far.count(keyword);
        let wrong = |what: String| Err(format!("line {}: {what}", number + 1));
        match keyword {
            "v" | "vn" => {
                let numbers = words.clone().take(3).filter(|word| word.parse::<f32>().is_ok()).count();
                if numbers < 3 {
                    return wrong(format!("\"{}\" does not have three numbers", shortened(line)));
                }
                // Colours and weights behind the position are not used; some exporters write them badly.
                let words: Vec<&str> = words.take(3).collect();
                push_line(&mut checked.text, &format!("{keyword} {}", words.join(" ")));
                continue;
            }
            "vt" => {
                // Where they are not used, the counts above keep relative numbers right.
                if with_textures {
                    let number = |word: Option<&str>| {
                        word.and_then(|word| word.parse::<f32>().ok()).filter(|number| number.is_finite())
                    };
                    let (u, v) = (number(words.next()).unwrap_or(0.0), number(words.next()).unwrap_or(0.0));
                    push_line(&mut checked.text, &format!("vt {u} {v}"));
                }
                continue;
            }
            "f" => {
                let mut corners = Vec::new();
                for word in words {
                    match corner(word, &so_far, &total, with_textures) {
                        Ok(corner) => corners.push(corner),
                        Err(what) => return wrong(what),
                    }
                }
                if corners.len() < 3 {
                    checked.ignored += 1;
                } else {
                    checked.faces += 1;
                    push_line(&mut checked.text, &format!("f {}", corners.join(" ")));
                }
                continue;
            }
            "p" | "l" | "curv" | "curv2" | "surf" => {
                checked.ignored += 1;
                continue;
            }
            "usemtl" if words.next().is_none() => continue,
            _ => {}
        }
        push_line(&mut checked.text, line);
    }
    Ok(checked)
}

fn push_line(text: &mut String, line: &str) {
    text.push_str(line);
    text.push('\n');
}

fn shortened(line: &str) -> String {
    line.trim().chars().take(60).collect()
}

/// A face's corner `position/texture/normal` with absolute numbers, with the texture's one higher or left out.
fn corner(word: &str, so_far: &Counts, total: &Counts, with_textures: bool) -> Result<String, String> {
    let mut numbers = word.split('/');
    let mut next = |what, so_far, total| match numbers.next() {
        None | Some("") => Ok(None),
        Some(text) => absolute(text, what, so_far, total).map(Some),
    };
    let position = next("vertex", so_far.positions, total.positions)?;
    let texture = next("texture coordinate", so_far.texture, total.texture)?;
    let normal = next("normal", so_far.normals, total.normals)?;
    let Some(position) = position else {
        return Err(format!("the face's corner \"{}\" names no vertex", shortened(word)));
    };
    let texture = if with_textures { (texture.unwrap_or(0) + 1).to_string() } else { String::new() };
    Ok(match normal {
        Some(normal) => format!("{position}/{texture}/{normal}"),
        None if with_textures => format!("{position}/{texture}"),
        None => position.to_string(),
    })
}

/// A one-based number that may count back from the latest, as a number from the start.
fn absolute(text: &str, what: &str, so_far: usize, total: usize) -> Result<usize, String> {
    let number: i64 =
        text.parse().map_err(|_| format!("the face's number \"{}\" is no number", shortened(text)))?;
    let from_start = if number < 0 { so_far as i64 + 1 + number } else { number };
    match usize::try_from(from_start) {
        Ok(index) if (1..=total).contains(&index) => Ok(index),
        _ => Err(format!("the face names {what} {number}, but there are only {total}")),
    }
}

/// Maps that are read: base colour, alpha, emission, roughness, metal, normals.
const MAPS: [&str; 6] = ["map_Kd", "map_d", "map_Ke", "map_Pr", "map_Pm", "norm"];

/// The material files that a scene names, in order.
pub(super) fn material_files(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter_map(|line| line.trim().strip_prefix("mtllib ")).map(str::trim)
}

/// A map as a material names it: its file, which is the last word that belongs to no option, and whether it is
/// clamped at its edges.
pub(super) fn map(line: &str) -> Option<(String, bool)> {
    let mut words = line.split_whitespace().peekable();
    let mut clamped = false;
    while let Some(option) = words.next_if(|word| word.starts_with('-')) {
        let is_number = |word: &&str| word.parse::<f32>().is_ok();
        match option {
            "-clamp" => clamped = words.next() == Some("on"),
            "-blendu" | "-blendv" | "-cc" | "-imfchan" | "-type" => drop(words.next()),
            // Those that move or scale have one to three numbers.
            _ => while words.next_if(is_number).is_some() {},
        }
    }
    let name = words.collect::<Vec<_>>().join(" ").replace('\\', "/");
    (!name.is_empty()).then_some((name, clamped))
}

/// Takes out the material lines that would stop the parser: colours, numbers and names that are not there.
pub(super) fn repair_materials(text: &str) -> String {
    let is_number = |word: &str| word.parse::<f32>().is_ok();
    let mut repaired = String::with_capacity(text.len());
    for line in text.lines() {
        let mut words = line.split_whitespace();
        let keep = match words.next().unwrap_or("") {
            "Ka" | "Kd" | "Ks" | "Ke" => words.take(3).filter(|word| is_number(word)).count() == 3,
            "Ns" | "Ni" | "d" => words.next().is_some_and(is_number),
            "illum" => words.next().is_some_and(|word| word.parse::<u8>().is_ok()),
            "newmtl" => words.next().is_some(),
            // Only these maps are looked at.
            keyword if keyword.starts_with("map_") || ["bump", "norm"].contains(&keyword) => {
                MAPS.contains(&keyword) && words.next().is_some()
            }
            _ => true,
        };
        if keep {
            push_line(&mut repaired, line.trim());
        }
    }
    repaired
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relative_numbers_count_from_where_they_stand() {
        let checked = check("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2/-1 -1\nv 5 5 5\n", false).err().unwrap();
        assert!(checked.contains("line 4") && checked.contains("texture coordinate -1"), "{checked}");
        let checked =
            check("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf -3//-1 -2//1 -1//1\nv 5 5 5\n", false).unwrap();
        assert!(checked.text.contains("f 1//1 2//1 3//1"));
        // A number may point forward.
        assert!(check("f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n", false).is_ok());
    }

    #[test]
    fn errors_name_the_line() {
        for (text, expected) in [
            ("v 0 0 0\nf 1 2 3\n", "line 2: the face names vertex 2, but there are only 1"),
            ("v 0 0\n", "line 1: \"v 0 0\" does not have three numbers"),
            ("v 0 0 zero\n", "line 1"),
            ("v 0 0 0\nf 0 1 1\n", "vertex 0"),
            ("v 0 0 0\nf 1 1 99999999999999999999\n", "no number"),
            ("v 0 0 0\nf / 1 1\n", "names no vertex"),
        ] {
            let message = check(text, false).err().unwrap();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn lines_and_points_are_taken_out_and_counted() {
        let checked = check("v 0 0 0\np 1\nl 1 1 1\nf 1 1\nusemtl \nf 1 1 \\\n 1\n", false).unwrap();
        assert_eq!((checked.ignored, checked.faces), (3, 1));
        assert_eq!(checked.text, "v 0 0 0\nf 1 1 1\n");
    }

    #[test]
    fn corners_without_texture_coordinates_get_some() {
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvt 0.5 1\nvt nan x\nf 1/1 2/-1/1 3\n";
        let checked = check(text, true).unwrap().text;
        assert!(checked.starts_with("vt 0 0\n") && checked.contains("vt 0.5 1\nvt 0 0\n"), "{checked}");
        assert!(checked.ends_with("f 1/2 2/3/1 3/1\n"), "{checked}");
        let without = check(text, false).unwrap().text;
        assert!(!without.contains("vt") && without.ends_with("f 1 2//1 3\n"), "{without}");
    }

    #[test]
    fn maps_are_told_from_their_options() {
        assert_eq!(map("leaf one.png"), Some(("leaf one.png".to_owned(), false)));
        assert_eq!(map("-s 2 2 2 -clamp on -bm 0.5 a\\b.tga"), Some(("a/b.tga".to_owned(), true)));
        assert_eq!((map(""), map("-o 1 2 3")), (None, None));
        let names: Vec<&str> = material_files("mtllib a.mtl\nv 1 2 3\n mtllib b c.mtl \nmtllib\n").collect();
        assert_eq!(names, ["a.mtl", "b c.mtl"]);
    }

    #[test]
    fn bad_material_lines_are_taken_out() {
        let text = "newmtl a\nKd 1 0\nKs x y z\nNs\nillum many\nmap_Kd\nmap_bump b.png\nKe 1 2 3\nnewmtl\n";
        assert_eq!(repair_materials(text), "newmtl a\nKe 1 2 3\n");
    }
}
