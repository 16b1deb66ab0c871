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

/// Checks numbers and faces, and takes out what no triangle comes of.
///
/// # Errors
/// One sentence that names the line and what is wrong with it.
pub(super) fn check(text: &str) -> Result<Checked, String> {
    // A line that ends in a backslash goes on in the next.
    let text = text.replace("\\\r\n", " ").replace("\\\n", " ");
    let mut total = Counts::default();
    for line in text.lines() {
        total.count(line.split_whitespace().next().unwrap_or(""));
    }
    let mut checked = Checked { text: String::with_capacity(text.len()), ignored: 0, faces: 0 };
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
            // Texture coordinates are not used; the counts above keep relative numbers right.
            "vt" => continue,
            "f" => {
                let mut corners = Vec::new();
                for word in words {
                    match corner(word, &so_far, &total) {
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

/// A face's corner `position/texture/normal` with absolute numbers and without the texture.
fn corner(word: &str, so_far: &Counts, total: &Counts) -> Result<String, String> {
    let mut numbers = word.split('/');
    let mut next = |what, so_far, total| match numbers.next() {
        None | Some("") => Ok(None),
        Some(text) => absolute(text, what, so_far, total).map(Some),
    };
    let position = next("vertex", so_far.positions, total.positions)?;
    next("texture coordinate", so_far.texture, total.texture)?;
    let normal = next("normal", so_far.normals, total.normals)?;
    match (position, normal) {
        (None, _) => Err(format!("the face's corner \"{}\" names no vertex", shortened(word))),
        (Some(position), None) => Ok(position.to_string()),
        (Some(position), Some(normal)) => Ok(format!("{position}//{normal}")),
    }
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
            // Only this map is looked at.
            keyword if keyword.starts_with("map_") || keyword == "bump" => {
                keyword == "map_Kd" && words.next().is_some()
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
        let checked = check("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2/-1 -1\nv 5 5 5\n").err().unwrap();
        assert!(checked.contains("line 4") && checked.contains("texture coordinate -1"), "{checked}");
        let checked = check("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf -3//-1 -2//1 -1//1\nv 5 5 5\n").unwrap();
        assert!(checked.text.contains("f 1//1 2//1 3//1"));
        // A number may point forward.
        assert!(check("f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n").is_ok());
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
            let message = check(text).err().unwrap();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn lines_and_points_are_taken_out_and_counted() {
        let checked = check("v 0 0 0\np 1\nl 1 1 1\nf 1 1\nusemtl \nf 1 1 \\\n 1\n").unwrap();
        assert_eq!((checked.ignored, checked.faces), (3, 1));
        assert_eq!(checked.text, "v 0 0 0\nf 1 1 1\n");
    }

    #[test]
    fn bad_material_lines_are_taken_out() {
        let text = "newmtl a\nKd 1 0\nKs x y z\nNs\nillum many\nmap_Kd\nmap_bump\nKe 1 2 3\nnewmtl\n";
        assert_eq!(repair_materials(text), "newmtl a\nKe 1 2 3\n");
    }
}
