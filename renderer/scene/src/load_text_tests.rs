//! OBJ, MTL and PLY as people's programs write them: valid or easily understood files are read.

use glam::Vec3;

use super::load_tests::{load_bytes, load_files, material, told};
use super::{Bounds, Scene, Up};

const CORNERS: &str = "v -1 -1 -1\nv -1 -1 1\nv -1 1 -1\nv -1 1 1\nv 1 -1 -1\nv 1 -1 1\nv 1 1 -1\nv 1 1 1\n";
const FACES: &str = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n";
const LAMP: &str = "newmtl lamp\nKd 0 0 0\nKe 1 0 0\n";

/// The cube of the constants above: its triangles and its box.
fn is_the_cube(scene: &Scene) -> bool {
    let bounds = Bounds { min: Vec3::NEG_ONE, max: Vec3::ONE };
    scene.triangles.len() == 12 && scene.bounds() == bounds
}

fn obj(bytes: &[u8]) -> Scene {
    load_bytes("cube.obj", bytes).unwrap()
}

/// The scene of the first file among others.
fn beside(files: &[(&str, &[u8])]) -> Scene {
    load_files(files, Up::Y).unwrap()
}

/// Area of all triangles, and of all in the direction of a normal.
fn areas(scene: &Scene, normal: Vec3) -> (f32, f32) {
    let vectors = (0..scene.triangles.len()).map(|triangle| {
        let [a, b, c] = scene.triangles.corners(triangle).map(Vec3::from);
        (b - a).cross(c - a) * 0.5
    });
    vectors.fold((0.0, 0.0), |(all, along), vector| (all + vector.length(), along + vector.dot(normal)))
}

#[test]
fn a_concave_face_covers_what_its_outline_does() {
    let outline = "v 0 4 0\nv 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nf 1 2 3 4 5\n";
    assert_eq!(areas(&obj(outline.as_bytes()), Vec3::Z), (10.0, 10.0));
    let ply = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
               element face 1\nproperty list uchar int vertex_indices\nend_header\n0 4 0\n0 0 0\n4 0 0\n4 4 0\n2 1 0\n\
               5 0 1 2 3 4\n";
    assert_eq!(areas(&load_bytes("outline.ply", ply.as_bytes()).unwrap(), Vec3::Z), (10.0, 10.0));
    // Faces may stand before their vertices.
    let ply = "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\nelement vertex 4\n\
               property float x\nproperty float y\nproperty float z\nend_header\n4 0 1 2 3\n0 0 0\n2 -2 0\n0 4 0\n-2 -2 0\n";
    assert_eq!(areas(&load_bytes("before.ply", ply.as_bytes()).unwrap(), Vec3::Z), (8.0, 8.0));
}

#[test]
fn a_byte_order_mark_costs_no_line() {
    let marked = format!("\u{feff}{}", ply("\n", "\n"));
    assert!(is_the_cube(&load_bytes("marked.ply", marked.as_bytes()).unwrap()));
}

#[test]
fn numbers_of_missing_corners_count_as_none() {
    let astray = obj(format!("{CORNERS}{}", FACES.replace(" 4", " 4/7")).as_bytes());
    assert!(is_the_cube(&astray) && astray.normals.is_empty());
    told(&astray, "Ignored 3 numbers of texture coordinates or normals");
    // Where only some corners have a normal, theirs stays.
    let some = obj(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0.6 0.8\nf 1//1 2//0 3//1\n");
    assert_eq!(some.normals[0], Vec3::new(0.0, 0.6, 0.8));
    assert_eq!(some.normals[1], Vec3::Z);
}

#[test]
fn material_files_may_be_named_behind_their_use() {
    let body = format!("usemtl lamp\n{CORNERS}{FACES}");
    let named = format!("{body}mtllib b.mtl gone.mtl\n");
    let scene = beside(&[("s.obj", named.as_bytes()), ("b.mtl", LAMP.as_bytes())]);
    assert_eq!(material(&scene).emission, Vec3::X);
    told(&scene, "gone.mtl cannot be read");
    told(&obj(body.as_bytes()), "1 materials, such as lamp, stand in no material file");
}

#[test]
fn a_dissolved_surface_lets_light_through_untinted() {
    let sheet = |lines: &str| {
        let library = format!("newmtl sheet\n{lines}");
        let body = format!("mtllib m.mtl\nusemtl sheet\n{CORNERS}{FACES}");
        material(&beside(&[("s.obj", body.as_bytes()), ("m.mtl", library.as_bytes())]))
    };
    for lines in [
        "Kd 0 0 0\nillum 1\nd 0.5\n",
        "Kd 0 0 0\nTr 0.5\n",
        "Kd 0 0 0\nd -halo 0.5 # half\n",
        "KD 0\nD 0.5\n",
    ] {
        let found = sheet(lines);
        assert_eq!((found.base_color, found.transmission, found.opacity), (Vec3::ZERO, 0.5, 0.5), "{lines}");
        assert!(found.blends && found.ior == 1.0, "{lines}");
    }
    let glass = sheet("Kd 1 0 0\nd 0.25\nNi 1.4\n");
    assert_eq!((glass.ior, glass.blends, glass.transmission), (1.4, true, 0.75));
    assert!(!sheet("Kd 1 0 0\nd 1\n").blends);
}

/// The cube as PLY text, with these line ends in the header and between the words of the body.
fn ply(end: &str, between: &str) -> String {
    let head = [
        "ply",
        "format ascii 1.0",
        "element vertex 8",
        "property float x",
        "property float y",
        "property float z",
        "element face 6",
        "property list uchar int vertex_indices",
        "end_header",
    ];
    let head: String = head.iter().flat_map(|line| [line, end]).collect();
    let faces = FACES.lines().map(|line| {
        let corners = line.split(' ').skip(1).filter_map(|word| word.parse::<u8>().ok());
        let corners: String = corners.map(|corner| format!(" {}", corner - 1)).collect();
        format!("4{corners}\n")
    });
    let body: String = CORNERS.replace("v ", "") + &faces.collect::<String>();
    head + &body.replace('\n', between)
}

#[test]
fn every_kind_of_line_end_is_one() {
    for end in ["\r", "\r\n", "\n"] {
        assert!(is_the_cube(&obj(format!("{CORNERS}{FACES}").replace('\n', end).as_bytes())), "{end:?}");
        assert!(is_the_cube(&load_bytes("cube.ply", ply(end, end).as_bytes()).unwrap()), "{end:?}");
        let scene = beside(&[
            ("s.obj", format!("mtllib m.mtl\nusemtl lamp\n{CORNERS}{FACES}").as_bytes()),
            ("m.mtl", LAMP.replace('\n', end).as_bytes()),
        ]);
        assert_eq!(material(&scene).emission, Vec3::X, "{end:?}");
    }
}

#[test]
fn old_words_are_read() {
    // Faces before version 3.0 of the format, and a first word in capitals.
    assert!(is_the_cube(&obj(format!("{CORNERS}{}", FACES.replace("f ", "fo ")).as_bytes())));
    let capital = ply("\n", "\n").replacen("ply", "PLY", 1);
    assert!(is_the_cube(&load_bytes("cube.ply", capital.as_bytes()).unwrap()));
}

#[test]
fn ply_elements_may_take_several_lines_or_share_one() {
    for text in
        [ply("\n", " "), ply("\n", "\n\n"), ply("\n", "\n").replace(" 1\n", "\n1\n"), ply("\r", " \r ")]
    {
        assert!(is_the_cube(&load_bytes("cube.ply", text.as_bytes()).unwrap()), "{text}");
    }
    let short = ply("\n", " ").trim_end().trim_end_matches('3').to_owned();
    assert!(load_bytes("short.ply", short.as_bytes()).is_err());
}

#[test]
fn a_binary_ply_has_a_body_wherever_its_header_ends() {
    for end in ["\r", "\r\n", "\n"] {
        let head = ply(end, " ");
        let head = head[..head.find("end_header").unwrap() + "end_header".len()]
            .replace("ascii", "binary_little_endian");
        // A comment in another encoding, which is no UTF-8.
        let head = head.replace(&format!("1.0{end}"), &format!("1.0{end}comment caf\u{fffd}{end}"));
        let mut bytes = format!("{head}{end}").into_bytes();
        for line in CORNERS.lines() {
            bytes.extend(line.split(' ').skip(1).flat_map(|word| word.parse::<f32>().unwrap().to_le_bytes()));
        }
        for line in FACES.lines() {
            bytes.push(4);
            let corners = line.split(' ').skip(1).map(|word| word.parse::<i32>().unwrap() - 1);
            bytes.extend(corners.flat_map(i32::to_le_bytes));
        }
        let place = bytes.windows(3).position(|window| window == "\u{fffd}".as_bytes()).unwrap();
        bytes.splice(place..place + 3, [0xe9]);
        assert!(is_the_cube(&load_bytes("cube.ply", &bytes).unwrap()), "{end:?}");
    }
}

#[test]
fn what_is_left_out_is_told_once_with_its_count() {
    let coloured = CORNERS.replace('\n', " 1 0 0\n");
    let library = "newmtl lamp\nKd 1 1 1\nmap_bump a.png\nTf 1 1 1\nnewmtl b\nTf 0 0 0\n";
    let scene = beside(&[
        ("s.obj", format!("mtllib m.mtl\nusemtl lamp\n{coloured}{FACES}l 1 2\n").as_bytes()),
        ("m.mtl", library.as_bytes()),
    ]);
    for note in ["Ignored 8 colours of vertices", "Ignored 1 points, lines", "Tf (2), map_bump (1)"] {
        told(&scene, note);
    }
    let text = ply("\n", "\n")
        .replace("float z\n", "float z\nproperty uchar red\n")
        .replace("end_header\n", "element edge 1\nproperty int a\nend_header\n");
    let text: String = text
        .lines()
        .map(|line| {
            let is_vertex =
                line.split(' ').count() == 3 && line.split(' ').all(|word| word.parse::<i8>().is_ok());
            if is_vertex { format!("{line} 255\n") } else { format!("{line}\n") }
        })
        .collect();
    let scene = load_bytes("coloured.ply", format!("{text}7\n").as_bytes()).unwrap();
    told(&scene, "Ignored 8 colours of vertices");
    told(&scene, "Ignored 1 elements \"edge\"");
    assert!(is_the_cube(&scene));
}
