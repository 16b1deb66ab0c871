//! Scene extras: cameras and lights that a converter wrote into the `extras` of a glTF scene in the terms of
//! the renderer the scene was made for.
//!
//! ```json
//! { "cameras": [
//!     { "lookat": [eye x, y, z, target x, y, z, up x, y, z] },
//!     { "type": "perspective", "world_to_camera": [[4 numbers] * 4 rows], "params": { "fov": [degrees] } },
//!     { "type": "perspective", "to_world": ["16 numbers, row by row"], "fov": ["degrees"], "fovAxis": ["x"|"y"],
//!       "width": pixels, "height": pixels } ],
//!   "lights": [ { "type": "sunsky" | "envmap" | "infinite" | "area" | ..., "params": { ... } } ] }
//! ```
//!
//! Camera space has z forward and y up. A `lookat` belongs to the camera after it. The angle of a
//! `world_to_camera` camera is across the shorter side of the picture, that of a `to_world` camera across the
//! width unless `fovAxis` is y; then pictures without a size are taken to be 16:9. Area lights are meshes
//! with an emissive material already. Numbers may stand as numbers or text, alone or in a list; entries of
//! another form are ignored.

use glam::{Mat4, Vec3};
use serde_json::Value;

use super::{Sky, Sun, framing::CameraPose, text::counted};

/// Width over height of the pictures that such cameras were made for, where they do not say it.
const ASPECT: f32 = 16.0 / 9.0;

#[derive(Debug, Default)]
pub(super) struct Extras {
    pub(super) views: Vec<CameraPose>,
    pub(super) sky: Option<Sky>,
    pub(super) notes: Vec<String>,
}

pub(super) fn parse(json: &str) -> Extras {
    let mut extras = Extras::default();
    let Ok(value) = serde_json::from_str::<Value>(json) else { return extras };
    let list = |key: &str| value.get(key).and_then(Value::as_array).cloned().unwrap_or_default();
    let (mut look_at, mut shapeless) = (None, 0);
    for camera in list("cameras") {
        if let Some(&[ex, ey, ez, tx, ty, tz, ux, uy, uz]) = camera.get("lookat").map(numbers).as_deref() {
            look_at = Some((Vec3::new(ex, ey, ez), Vec3::new(tx, ty, tz), Vec3::new(ux, uy, uz)));
        } else if let Some(view) = view(&camera, look_at.take()) {
            shapeless += usize::from(view.framed_aspect == Some(ASPECT) && shape(&camera).is_none());
            extras.views.push(view);
        }
    }
    extras.notes.extend(counted(
        shapeless,
        "{} cameras say the angle across the width of a picture, but not its shape; it is taken for 16:9.",
    ));
    for light in list("lights") {
        match light.get("type").and_then(Value::as_str) {
            Some("area") => {}
            Some("sunsky" | "sun" | "sky") => {
                let mut sky = Sky::daylight();
                let direction = light.pointer("/params/sunDirection").map(numbers);
                if let (Some(&[x, y, z]), Some(sun)) = (direction.as_deref(), sky.sun) {
                    sky.sun = Some(Sun::towards(Vec3::new(x, y, z), sun.irradiance));
                }
                extras.sky = Some(sky);
                extras.notes.push("The file's sun and sky are replaced by a plain daylight sky.".to_owned());
            }
            Some("envmap" | "infinite") => {
                extras.sky = Some(Sky::daylight());
                extras
                    .notes
                    .push("The file's environment picture is replaced by a plain daylight sky.".to_owned());
            }
            Some(other) => extras.notes.push(format!("Ignored a light of type \"{other}\".")),
            None => {}
        }
    }
    let skipped = "The file says that {} of its source's objects are missing.";
    extras.notes.extend(counted(list("skipped").len(), skipped));
    extras
}

fn view(camera: &Value, look_at: Option<(Vec3, Vec3, Vec3)>) -> Option<CameraPose> {
    let (to_world, fov) = if let Some(matrix) = camera.get("world_to_camera") {
        (matrix_of(matrix)?.inverse(), camera.pointer("/params/fov"))
    } else {
        (matrix_of(camera.get("to_world")?)?, camera.get("fov"))
    };
    let fov_deg = fov.map(numbers).and_then(|fov| fov.first().copied()).unwrap_or(50.0);
    let axis = camera.get("fovAxis").and_then(|axis| axis.get(0).or(Some(axis))).and_then(Value::as_str);
    let is_shorter = camera.get("world_to_camera").is_some();
    let shape = shape(camera);
    let aspect = shape.unwrap_or(ASPECT);
    // Across the shorter side is vertical in a square picture, and horizontal in a narrower one.
    let (vertical_fov_deg, framed_aspect) = match (is_shorter, axis) {
        (true, _) => (fov_deg, Some(1.0)),
        (false, Some("y")) => (fov_deg, shape),
        _ => (2.0 * ((fov_deg.to_radians() * 0.5).tan() / aspect).atan().to_degrees(), Some(aspect)),
    };
    let (position, forward, up) =
        (to_world.w_axis.truncate(), to_world.z_axis.truncate(), to_world.y_axis.truncate());
    let pose = CameraPose { position, forward, up, vertical_fov_deg, framed_aspect, distance: None };
    Some(look_at.map_or(pose, |(position, target, up)| {
        let (forward, distance) = (target - position, Some(position.distance(target)));
        CameraPose { position, forward, up, distance, ..pose }
    }))
}

/// Width over height of a camera's picture, where it says it.
fn shape(camera: &Value) -> Option<f32> {
    let number = |key: &str| camera.get(key).map(numbers).and_then(|found| found.first().copied());
    let shape = number("width")? / number("height")?;
    (shape.is_finite() && shape > 0.0).then_some(shape)
}

/// A matrix written row by row.
fn matrix_of(value: &Value) -> Option<Mat4> {
    let numbers: [f32; 16] = numbers(value).try_into().ok()?;
    Some(Mat4::from_cols_array(&numbers).transpose())
}

/// All numbers in a value: numbers, text with numbers, lists of either.
fn numbers(value: &Value) -> Vec<f32> {
    match value {
        Value::Number(number) => number.as_f64().map(|number| number as f32).into_iter().collect(),
        Value::String(text) => {
            text.split([' ', ',', '\t', '\n']).filter_map(|word| word.parse().ok()).collect()
        }
        Value::Array(list) => list.iter().flat_map(numbers).collect(),
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_three_ways_to_write_a_camera() {
        let extras = parse(
            r#"{"cameras": [
                {"lookat": [0, 1, 5, 0, 1, 0, 0, 1, 0]},
                {"type": "perspective", "params": {"fov": [30]},
                 "world_to_camera": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]},
                {"type": "perspective", "params": {"fov": [40]},
                 "world_to_camera": [[1,0,0,-2],[0,1,0,-3],[0,0,1,4],[0,0,0,1]]},
                {"type": "perspective", "fov": ["90"], "fovAxis": [],
                 "to_world": ["-1 0 0 7 0 1 0 8 0 0 -1 9 0 0 0 1"]},
                {"type": "perspective", "to_world": ["1 2 3"]}, 17]}"#,
        );
        assert_eq!(extras.views.len(), 3);
        let [first, second, third] = [0, 1, 2].map(|index| extras.views[index]);
        assert_eq!((first.position, first.vertical_fov_deg), (Vec3::new(0.0, 1.0, 5.0), 30.0));
        assert_eq!((first.forward.normalize(), first.distance), (Vec3::NEG_Z, Some(5.0)));
        assert_eq!((second.position, second.forward), (Vec3::new(2.0, 3.0, -4.0), Vec3::Z));
        assert_eq!((third.position, third.forward), (Vec3::new(7.0, 8.0, 9.0), Vec3::NEG_Z));
        // Ninety degrees across 16 units are 2 atan(9/16) across 9.
        assert!((third.vertical_fov_deg - 58.715).abs() < 0.01);
        assert_eq!((second.framed_aspect, third.framed_aspect), (Some(1.0), Some(16.0 / 9.0)));
    }

    #[test]
    fn upright_pictures_show_what_they_were_made_to_show() {
        let bounds = crate::Bounds { min: Vec3::NEG_ONE, max: Vec3::ONE };
        let camera = |more: &str| {
            let matrix = "\"to_world\": [\"-1 0 0 7 0 1 0 8 0 0 -1 9 0 0 0 1\"], \"fov\": 90";
            parse(&format!("{{\"cameras\": [{{{matrix}{more}}}]}}")).views[0].aim(&bounds).unwrap()
        };
        // Ninety degrees across the width, for any height.
        for (width, height) in [(9.0, 16.0), (1.0, 2.0), (16.0, 9.0)] {
            let half_height = camera("").half_height(width / height);
            assert!((half_height * width / height - 1.0).abs() < 1e-5);
        }
        let upright = camera(", \"width\": 600, \"height\": 800");
        assert!((upright.half_height(0.75) - 4.0 / 3.0).abs() < 1e-5);
        // A wider picture shows as much of the height and more at the sides.
        assert!((upright.half_height(2.0) - 4.0 / 3.0).abs() < 1e-5);
        // An angle across the height holds for every picture, unless it was made for a wider one.
        for aspect in [0.5, 1.0, 2.0] {
            assert!((camera(", \"fovAxis\": \"y\"").half_height(aspect) - 1.0).abs() < 1e-5);
        }
        let wide = camera(", \"fovAxis\": \"y\", \"width\": 800, \"height\": 400");
        assert!((wide.half_height(1.0) - 2.0).abs() < 1e-5);
    }

    #[test]
    fn a_guessed_shape_is_told() {
        let notes = |more: &str| {
            let matrix = "\"to_world\": [\"-1 0 0 7 0 1 0 8 0 0 -1 9 0 0 0 1\"], \"fov\": 35";
            parse(&format!("{{\"cameras\": [{{{matrix}{more}}}]}}")).notes
        };
        assert!(notes("").iter().any(|note| note.starts_with("1 cameras") && note.contains("16:9")));
        assert_eq!(notes(", \"width\": 720, \"height\": 1280"), Vec::<String>::new());
        assert_eq!(notes(", \"fovAxis\": \"y\""), Vec::<String>::new());
    }

    #[test]
    fn lights_that_are_no_meshes_become_a_sky() {
        assert!(parse(r#"{"lights": [{"type": "area", "mesh": 3}]}"#).sky.is_none());
        let sky =
            parse(r#"{"lights": [{"type": "sunsky", "params": {"sunDirection": ["0 2 0"]}}]}"#).sky.unwrap();
        assert_eq!(sky.sun.unwrap().direction, Vec3::Y);
        let extras = parse(r#"{"lights": [{"type": "infinite"}, {"type": "laser"}], "skipped": ["one"]}"#);
        assert_eq!(extras.sky, Some(Sky::daylight()));
        assert_eq!(extras.notes.len(), 3);
    }

    #[test]
    fn other_extras_mean_nothing() {
        for json in
            ["null", "[1]", "{\"cameras\": 3, \"lights\": {}}", "{\"name\": \"monkey\", \"age\": 32}", "{"]
        {
            let extras = parse(json);
            assert!(extras.views.is_empty() && extras.sky.is_none() && extras.notes.is_empty(), "{json}");
        }
    }
}
