//! MTL files: the names that an OBJ gives, and the materials that they hold.

use std::{collections::BTreeMap, path::Path};

use glam::Vec3;

use super::obj_text::{keyword_and_rest, statements};

/// The keywords that are read, as they are spelt. Some write other capitals.
const READ: [&str; 18] = [
    "newmtl", "Ka", "Kd", "Ks", "Ke", "Ns", "Ni", "d", "Tr", "illum", "Pr", "Pm", "map_Kd", "map_d",
    "map_Ke", "map_Pr", "map_Pm", "norm",
];

/// The material files that an OBJ names, each once; names without a file are also tried repaired.
pub(super) fn libraries(text: &str, folder: &Path) -> Vec<String> {
    let mut names = Vec::new();
    for (_, statement) in statements(text) {
        if let ("mtllib", rest) = keyword_and_rest(&statement)
            && !rest.is_empty()
        {
            names.extend(found(rest, folder));
        }
    }
    let mut once = std::collections::BTreeSet::new();
    names.retain(|name| once.insert(name.clone()));
    names
}

fn found(rest: &str, folder: &Path) -> Vec<String> {
    let plain = |name: &str| name.trim().trim_matches(['"', '\'']).to_owned();
    let is_file = |name: &String| folder.join(name).is_file();
    let whole = [rest.to_owned(), plain(rest), plain(rest).replace('\\', "/")];
    if let Some(name) = whole.into_iter().find(|name| is_file(name)) {
        return vec![name];
    }
    let several = split(rest).into_iter().map(|name| {
        let name = plain(&name);
        let turned = name.replace('\\', "/");
        if !is_file(&name) && is_file(&turned) { turned } else { name }
    });
    let several: Vec<String> = several.filter(|name| !name.is_empty()).collect();
    if several.iter().any(is_file) { several } else { vec![plain(rest)] }
}

/// Several names on a line: in quotes, or up to their ending, or up to a space.
fn split(rest: &str) -> Vec<String> {
    let mut names = Vec::new();
    let mut rest = rest.trim();
    while !rest.is_empty() {
        let quote = rest.chars().next().filter(|first| ['"', '\''].contains(first));
        let end = match quote {
            Some(quote) => rest[1..].find(quote).map(|end| end + 2),
            None => {
                let ending = rest.to_ascii_lowercase().find(".mtl ").map(|end| end + 4);
                ending.or_else(|| rest.find(char::is_whitespace))
            }
        };
        let (name, following) = rest.split_at(end.unwrap_or(rest.len()));
        names.push(name.to_owned());
        rest = following.trim();
    }
    names
}

/// A map as a material names it: its file, the last word of no option, and whether it is clamped.
pub(super) fn map(line: &str) -> Option<(String, bool)> {
    let mut words = line.split_whitespace().peekable();
    let mut clamped = false;
    while let Some(option) = words.next_if(|word| word.starts_with('-')) {
        let is_number = |word: &&str| word.parse::<f32>().is_ok();
        match option {
            "-clamp" => clamped = words.next() == Some("on"),
            "-blendu" | "-blendv" | "-cc" | "-imfchan" | "-type" => drop(words.next()),
            // Options that move or scale have one to three numbers.
            _ => while words.next_if(is_number).is_some() {},
        }
    }
    let name = words.collect::<Vec<_>>().join(" ").trim_matches('"').replace('\\', "/");
    (!name.is_empty()).then_some((name, clamped))
}

/// A material as its file describes it: what follows each keyword.
#[derive(Debug, Default)]
pub(super) struct Described {
    pub(super) name: String,
    values: BTreeMap<&'static str, String>,
}

impl Described {
    pub(super) fn get(&self, keyword: &str) -> Option<&str> {
        self.values.get(keyword).map(String::as_str)
    }

    pub(super) fn number(&self, keyword: &str) -> Option<f32> {
        self.get(keyword)?.parse().ok()
    }

    pub(super) fn colour(&self, keyword: &str) -> Option<Vec3> {
        let parts: Option<Vec<f32>> = self.get(keyword)?.split(' ').map(|part| part.parse().ok()).collect();
        Some(Vec3::from_array(parts?.try_into().ok()?))
    }
}

/// Reads materials. What is missing is left out; keywords that are not read are counted in `ignored`.
pub(super) fn materials(text: &str, ignored: &mut BTreeMap<String, usize>) -> Vec<Described> {
    let mut materials: Vec<Described> = Vec::new();
    for (_, statement) in statements(text) {
        let (keyword, rest) = keyword_and_rest(&statement);
        let Some(spelt) = READ.iter().find(|known| known.eq_ignore_ascii_case(keyword)) else {
            if !keyword.is_empty() {
                *ignored.entry(keyword.to_owned()).or_default() += 1;
            }
            continue;
        };
        let Some(value) = value(spelt, rest) else { continue };
        if *spelt == "newmtl" {
            materials.push(Described { name: value, ..Described::default() });
        } else if let Some(material) = materials.last_mut() {
            material.values.insert(*spelt, value);
        }
    }
    materials
}

/// The text behind a keyword, if it is of its kind.
fn value(keyword: &str, rest: &str) -> Option<String> {
    let words = || rest.split_whitespace().skip_while(|word| *word == "-halo");
    let number = |word: &&str| word.parse::<f32>().is_ok();
    match keyword {
        "Ka" | "Kd" | "Ks" | "Ke" => match words().take(3).take_while(number).collect::<Vec<_>>()[..] {
            [grey] => Some(format!("{grey} {grey} {grey}")),
            [red, green, blue] => Some(format!("{red} {green} {blue}")),
            _ => None,
        },
        "Ns" | "Ni" | "d" | "Tr" | "Pr" | "Pm" => words().next().filter(number).map(str::to_owned),
        _ => (!rest.is_empty()).then(|| rest.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_are_told_from_their_options() {
        assert_eq!(map("leaf one.png"), Some(("leaf one.png".to_owned(), false)));
        assert_eq!(map("-s 2 2 2 -clamp on -bm 0.5 a\\b.tga"), Some(("a/b.tga".to_owned(), true)));
        assert_eq!(map("\"leaf one.png\""), Some(("leaf one.png".to_owned(), false)));
        assert_eq!((map(""), map("-o 1 2 3")), (None, None));
    }

    #[test]
    fn libraries_are_found_however_they_are_named() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("sub")).unwrap();
        for name in ["a.mtl", "b.mtl", "my mats.mtl", "sub/c.mtl", "x.mtl y.mtl"] {
            std::fs::write(folder.path().join(name), "newmtl m\n").unwrap();
        }
        let names = |text: &str| libraries(text, folder.path());
        assert_eq!(names("mtllib a.mtl b.mtl\nv 1 2 3\n mtllib\tb.mtl \nmtllib\n"), ["a.mtl", "b.mtl"]);
        assert_eq!(names("mtllib \"my mats.mtl\"\nmtllib my mats.mtl\n"), ["my mats.mtl"]);
        assert_eq!(names("mtllib my mats.mtl a.mtl 'b.mtl'\n"), ["my mats.mtl", "a.mtl", "b.mtl"]);
        assert_eq!(names("mtllib .\\sub\\c.mtl\n"), ["./sub/c.mtl"]);
        assert_eq!(names("mtllib x.mtl y.mtl\n"), ["x.mtl y.mtl"], "a file of the whole name comes first");
        assert_eq!(names("mtllib a.mtl gone.mtl\n"), ["a.mtl", "gone.mtl"]);
        assert_eq!(names("mtllib gone one.mtl\n"), ["gone one.mtl"]);
    }

    #[test]
    fn bad_material_lines_are_left_out_and_the_others_told() {
        let text = "newmtl a\nKd 1 0\nKs x y z\nNs\nillum many\nmap_Kd\nmap_bump b.png\nKe 1 2 3 # bright\nnewmtl\n\
                    KD 0.5\nd -halo 0.25\nTr 0.5 # half\nmap_Bump c.png\nTf 1 1 1\n# end";
        let mut ignored = BTreeMap::new();
        let found = materials(text, &mut ignored);
        assert_eq!((found.len(), &found[0].name[..]), (1, "a"));
        let colours = ["Kd", "Ks", "Ke"].map(|keyword| found[0].colour(keyword));
        assert_eq!(colours, [Some(Vec3::splat(0.5)), None, Some(Vec3::new(1.0, 2.0, 3.0))]);
        let numbers = ["Ns", "d", "Tr"].map(|keyword| found[0].number(keyword));
        assert_eq!((numbers, found[0].get("map_Kd")), ([None, Some(0.25), Some(0.5)], None));
        let ignored: Vec<(&str, usize)> =
            ignored.iter().map(|(keyword, count)| (keyword.as_str(), *count)).collect();
        assert_eq!(ignored, [("Tf", 1), ("map_Bump", 1), ("map_bump", 1)]);
    }
}
