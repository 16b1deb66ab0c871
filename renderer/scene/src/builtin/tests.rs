//! The promises of every built-in scene.

use super::*;

fn small(name: &str, options: Options) -> Scene {
    build(name, &options).unwrap_or_else(|error| panic!("{name}: {error}"))
}

const SMALL: Options = Options { detail: 0.02, seed: 1, time: 0.0 };

#[test]
fn scenes_are_valid() {
    for name in names() {
        let scene = small(name, SMALL);
        assert_eq!(scene.name, name);
        assert!(scene.triangles.len() > 100, "{name}");
        let mut next = 0;
        for mesh in &scene.meshes {
            assert_eq!(mesh.first_triangle, next, "{name}: meshes cover all triangles in order");
            assert!((mesh.material as usize) < scene.materials.len());
            next += mesh.triangle_count;
        }
        assert_eq!(next as usize, scene.triangles.len());
        assert!(scene.normals.is_empty() || scene.normals.len() == scene.triangles.positions().len());
        assert!(scene.normals.iter().all(|normal| (normal.length() - 1.0).abs() < 1e-3), "{name}");
        assert_eq!(scene.cameras[0].position, scene.path_keys[0].position);
        assert!(scene.path_keys.len() >= 4, "{name}");
        let alike = scene.materials.iter().all(|material| *material == scene.materials[0]);
        assert_eq!(alike, name == "model", "{name} has varied materials, but for the model");
        assert_eq!(scene.environment.is_some(), name == "patio", "{name}");
        let zero_area = scene.notes.iter().any(|note| note.contains("without area"));
        assert!(!zero_area, "{name}: {:?}", scene.notes);
    }
}

#[test]
fn the_same_options_give_the_same_bytes() {
    for name in names() {
        let [a, b] = [small(name, SMALL), small(name, SMALL)];
        assert_eq!(a.triangles.indices(), b.triangles.indices());
        assert!(a.triangles.positions() == b.triangles.positions() && a.normals == b.normals, "{name}");
        let map = |scene: &Scene| scene.environment.as_ref().map(|map| map.pixels().to_vec());
        assert!(map(&a) == map(&b), "{name}");
        assert_eq!((a.materials, a.cameras, a.path_keys), (b.materials, b.cameras, b.path_keys));
        assert!(a.uvs == b.uvs && a.textures == b.textures, "{name}");
    }
}

#[test]
fn triangle_counts_keep_their_promise() {
    for (name, low, high) in [
        ("hall", 200_000, 300_000),
        ("gallery", 160_000, 240_000),
        ("needles", 80_000, 130_000),
        ("hair", 180_000, 195_000),
        ("cables", 130_000, 160_000),
        ("scaffold", 130_000, 155_000),
        ("city", 400_000, 560_000),
        ("sea", 170_000, 240_000),
        ("model", 400_000, 560_000),
        ("grove", 140_000, 230_000),
        ("doorway", 4_500, 4_900),
        ("quick", 16_000, 26_000),
        ("patio", 16_000, 26_000),
    ] {
        let count = small(name, Options::default()).triangles.len();
        assert!((low..=high).contains(&count), "{name} has {count} triangles");
    }
    // The dearer ones are measured at a twentieth.
    for (name, low, high) in [("voxels", 15_000, 45_000), ("statue", 42_000, 62_000)] {
        let count = small(name, Options { detail: 0.05, ..Options::default() }).triangles.len();
        assert!((low..=high).contains(&count), "{name} has {count} triangles at a twentieth");
    }
}

#[test]
fn the_market_has_lanterns_by_its_detail() {
    for (detail, low, high) in [(0.025, 250, 350), (1.0, 10_000, 12_000)] {
        let market = small("market", Options { detail, ..Options::default() });
        let lanterns = market.meshes.iter().filter(|mesh| mesh.name == "lanterns");
        let count: u32 = lanterns.map(|mesh| mesh.triangle_count).sum();
        assert!((low..=high).contains(&count), "{count} triangles shine at {detail}");
        let bounds = crate::Bounds::of(&market.triangles);
        assert!((bounds.max.x - 30.0).abs() < 1.0, "paving ends at {} at {detail}", bounds.max.x);
    }
}

#[test]
fn the_forest_is_large_by_its_instances() {
    let forest = small("forest", Options::default());
    let placed = forest.placed().count();
    assert!((9_000_000..=11_500_000).contains(&placed), "{placed} triangles are placed");
    assert!(forest.triangles.len() < 500_000, "{} triangles are unique", forest.triangles.len());
}

#[test]
fn the_grove_is_made_of_cards() {
    let grove = small("grove", SMALL);
    let cards = (0..grove.triangles.len()).filter(|triangle| grove.triangles.is_card(*triangle)).count();
    assert!(
        cards * 10 > grove.triangles.len() * 6,
        "{cards} of {} triangles have masks",
        grove.triangles.len()
    );
    assert!(grove.textures.len() >= 8 && grove.uvs.len() == grove.triangles.positions().len());
    for material in &grove.materials {
        assert!(
            material
                .all_textures()
                .into_iter()
                .flatten()
                .all(|number| (number as usize) < grove.textures.len())
        );
    }
}

#[test]
fn seeds_vary_and_detail_scales() {
    for name in ["voxels", "gallery", "hair", "cables", "scaffold", "city", "quick"] {
        let other = small(name, Options { seed: 2, ..SMALL });
        assert!(small(name, SMALL).triangles.positions() != other.triangles.positions(), "{name}");
    }
    for name in names() {
        let finer = small(name, Options { detail: 0.2, ..SMALL });
        assert!(finer.triangles.len() > small(name, SMALL).triangles.len(), "{name}");
    }
}

#[test]
fn needles_turn_while_the_hall_stands() {
    let at = |time: f32| small("needles", Options { time, ..SMALL });
    let [start, quarter, round] = [at(0.0), at(0.25), at(1.0)];
    assert_eq!(start.triangles.len(), quarter.triangles.len());
    let needle = start.triangles.len() - 1;
    assert!((start.triangles.corners(needle)[2] - quarter.triangles.corners(needle)[2]).length() > 1.0);
    assert_eq!(start.triangles.corners(0), quarter.triangles.corners(0));
    assert!(start.triangles.positions() == round.triangles.positions(), "a full round ends where it began");
    // Half as long as the diagonal of the hall.
    let hall = small("hall", Options { detail: SMALL.detail * 0.4, ..SMALL });
    let diagonal = crate::Bounds::of(&hall.triangles).diagonal();
    let [a, _, c] = start.triangles.corners(needle);
    let length = (c - a).length();
    assert!((0.45..0.56).contains(&(length / diagonal)), "{length} of {diagonal}");
}

#[test]
fn slender_scenes_are_made_of_long_thin_triangles_that_lean() {
    for name in ["hair", "cables", "scaffold"] {
        let triangles = small(name, SMALL).triangles;
        let is_slender = |triangle: &usize| {
            let [a, b, c] = triangles.corners(*triangle);
            let edges = [b - a, c - b, a - c].into_iter();
            let longest = edges.max_by(|one, other| one.length().total_cmp(&other.length())).expect("three");
            let height = (b - a).cross(c - a).length() / longest.length();
            let mut along = (longest / longest.length()).abs().to_array();
            along.sort_by(f32::total_cmp);
            longest.length() > 20.0 * height && along[1] > 0.1
        };
        let slender = (0..triangles.len()).filter(is_slender).count();
        assert!(slender * 2 > triangles.len(), "{name}: {slender} of {}", triangles.len());
    }
}

#[test]
fn animated_scenes_keep_their_triangles_and_come_round() {
    for name in names() {
        let at = |time: f32| small(name, Options { time, ..SMALL });
        let [start, later, round] = [at(0.0), at(0.4), at(1.0)];
        // Structures follow a motion by the numbers of the triangles.
        assert_eq!(start.triangles.indices(), later.triangles.indices(), "{name}");
        assert_eq!(start.triangles.positions() != later.triangles.positions(), is_animated(name), "{name}");
        assert!(start.triangles.positions() == round.triangles.positions(), "{name}");
    }
}

#[test]
fn options_and_names_are_checked() {
    let message = build("cathedral", &SMALL).unwrap_err().to_string();
    assert!(message.contains("cathedral") && message.contains("hall, voxels"), "{message}");
    for detail in [0.0, -1.0, f32::NAN, 100.0] {
        assert!(build("quick", &Options { detail, ..SMALL }).unwrap_err().to_string().contains("detail"));
    }
    assert!(build("needles", &Options { time: f32::INFINITY, ..SMALL }).is_err());
    assert!(names().all(|name| about(name).is_some()));
    assert!(about("cathedral").is_none());
}
