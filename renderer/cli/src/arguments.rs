//! Groups of arguments that several commands share, and the scenes, cameras and structures made from them.

use std::{path::PathBuf, str::FromStr, sync::Arc};

use clap::{Args, builder::TypedValueParser};
use glam::DVec3;
use treewright_accel::{BuildChoice, NativeOptions, NativeQuality};
use treewright_client::Configuration;

use crate::error::{CliError, Result};
use crate::names::{number_within, one_of};
pub use crate::scene_arguments::SceneArguments;
use treewright_renderer::frame::{Renderer, RendererError};
use treewright_renderer::limits::{BOUNCES_MAX, SIZE_MAX, THREADS_MAX};
use treewright_renderer::space::{self, Choice, LightKinds, Premises, Preset, Start, TuningSpace};
use treewright_renderer::{integrator::View, tuning::objective::Objective, tuning::workload::Workload};
use treewright_scene::camera_path::CameraPath;
use treewright_scene::limits::FOV_RANGE_DEG;
use treewright_scene::{Camera, Placement, Scene};

/// Which camera of the scene, or one of one's own.
#[derive(Args, Clone, Debug)]
pub struct CameraArguments {
    /// Number of the scene's camera, from 0.
    #[arg(long, value_name = "N", conflicts_with = "at")]
    pub camera: Option<usize>,

    /// Position on the scene's camera path, 0 to 1.
    #[arg(long, value_name = "T", value_parser = unit_interval)]
    pub at: Option<f32>,

    /// Position of the camera, instead of the chosen camera's. In the lengths of the scene's file, turned as
    /// `--up-axis` says, also where the scene is moved or scaled to be drawn.
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub eye: Option<DVec3>,

    /// Point that the camera looks at, in the lengths of `--eye`.
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub target: Option<DVec3>,

    /// Up direction of the picture.
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub up: Option<DVec3>,

    /// Vertical field of view in degrees, 0.01 to 170.
    #[arg(long, value_name = "DEG", value_parser = fov)]
    pub fov: Option<f32>,
}

impl CameraArguments {
    /// Finds the camera: the one asked for, a point of the path, or the scene's first. Given values replace
    /// its own.
    pub fn find(&self, scene: &Scene) -> Result<Camera> {
        let chosen = self.chosen(scene)?;
        let camera = self.changed(chosen, &scene.placement);
        if camera.position == camera.target {
            return Err(CliError::Usage(
                "--eye and --target are one point: a camera looks at another".to_owned(),
            ));
        }
        Ok(camera)
    }

    /// The camera with the given values in place of its own.
    pub fn changed(&self, camera: Camera, placement: &Placement) -> Camera {
        let given = |at: Option<DVec3>| at.map(|at| placement.in_scene(at));
        Camera {
            position: given(self.eye).unwrap_or(camera.position),
            target: given(self.target).unwrap_or(camera.target),
            up: self.up.map_or(camera.up, |up| up.as_vec3()),
            vertical_fov_deg: self.fov.unwrap_or(camera.vertical_fov_deg),
            framed_aspect: camera.framed_aspect.filter(|_| self.fov.is_none()),
        }
    }

    fn chosen(&self, scene: &Scene) -> Result<Camera> {
        match (self.camera, self.at) {
            (Some(number), _) => scene.cameras.get(number).copied().ok_or_else(|| {
                CliError::Usage(format!(
                    "there is no camera {number}; {} has {}, counted from 0",
                    scene.name,
                    scene.cameras.len()
                ))
            }),
            (None, Some(t)) => Ok(CameraPath::of(scene).sample(t)),
            (None, None) => Ok(scene.cameras[0]),
        }
    }
}

/// How a frame is rendered.
#[derive(Args, Clone, Copy, Debug)]
pub struct FrameArguments {
    /// Random seed; equal seeds give equal pictures.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Maximum number of bounces of a path.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(0..=i64::from(BOUNCES_MAX)))]
    pub bounces: u32,

    /// Threads for building and rendering; 0 for one per core.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = threads)]
    pub threads: usize,
}

impl FrameArguments {
    /// A renderer of a scene.
    pub fn renderer(&self, scene: &Arc<Scene>) -> Result<Renderer, RendererError> {
        Renderer::new(scene.clone(), self.threads)
    }

    /// The workload of its frames.
    pub fn workload(&self, scene: &Scene, size: Size) -> Workload {
        Workload::of(scene, size.0, self.bounces)
    }

    /// The view from a camera.
    pub fn view(&self, camera: Camera) -> View {
        View { camera, seed: self.seed, bounces: self.bounces }
    }
}

/// Pixels of a picture across and down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size(pub [u32; 2]);

impl std::fmt::Display for Size {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [width, height] = self.0;
        write!(formatter, "{width}x{height}")
    }
}

impl FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("a size is written WIDTHxHEIGHT, each 1 to {SIZE_MAX}, for example 640x480");
        let (width, height) = text.split_once(['x', 'X']).ok_or_else(wrong)?;
        let edge =
            |text: &str| text.parse().ok().filter(|edge| (1..=SIZE_MAX).contains(edge)).ok_or_else(wrong);
        Ok(Self([edge(width)?, edge(height)?]))
    }
}

/// A view that is measured: of which scene, from where, how it is rendered, and how large.
#[derive(Args, Clone, Debug)]
pub struct ViewArguments {
    /// Which scene.
    #[command(flatten)]
    pub scene: SceneArguments,

    /// Which camera.
    #[command(flatten)]
    pub camera: CameraArguments,

    /// How a frame is rendered.
    #[command(flatten)]
    pub frame: FrameArguments,

    /// Size in pixels.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "320x240")]
    pub size: Size,
}

/// Which parameters configurations are of.
#[derive(Args, Clone, Copy, Debug)]
pub struct SpaceArguments {
    /// Space of parameters (see `treewright-render spaces`).
    #[arg(long, value_parser = preset(), default_value = Preset::Full.name())]
    pub space: Preset,

    /// Watertight intersection at edges, at some cost. Never tuned, because it decides which hits are found.
    /// (In the paper's space it is a parameter.)
    #[arg(long)]
    pub robust: bool,
}

impl SpaceArguments {
    /// The space that an objective judges: where it has one of its own, that is meant when nothing is said.
    ///
    /// # Errors
    /// The two do not go together.
    pub fn judged_by(self, objective: Objective) -> Result<Self> {
        let (name, space) = (objective.name(), self.space.name());
        match (objective.own_space(), self.space) {
            (Some(own), Preset::Full) => Ok(Self { space: own, ..self }),
            (Some(own), given) if own == given => Ok(self),
            (None, Preset::Full | Preset::Paper) => Ok(self),
            (Some(own), _) => Err(CliError::Usage(format!(
                "--objective {name} says nothing of the space {space}; leave --space or --paper out, or name the space {}",
                own.name()
            ))),
            (None, given) => {
                let judge = Objective::KNOWN.into_iter().find(|one| one.own_space() == Some(given));
                let judge = judge.map_or("", Objective::name);
                Err(CliError::Usage(format!(
                    "--objective {name} says nothing of the space {space}: add --objective {judge}"
                )))
            }
        }
    }

    /// The space of a study: one for all scenes, but for light sampling.
    pub fn of(&self, scene: &Scene, objective: Objective) -> Result<TuningSpace> {
        self.checked(self.premises(scene, objective))
    }

    /// The facts that decide about the space.
    pub fn premises(&self, scene: &Scene, objective: Objective) -> Premises {
        Premises {
            builds_each_frame: objective.begins_with_cheap_builds(),
            robust: self.robust,
            lights: if self.space == Preset::Light { LightKinds::of(scene) } else { LightKinds::ALL },
        }
    }

    /// The space with every parameter there is, to read configurations with.
    pub fn whole(&self, objective: Objective) -> Result<TuningSpace> {
        let builds_each_frame = objective.begins_with_cheap_builds();
        self.checked(Premises { builds_each_frame, robust: self.robust, ..Premises::all() })
    }

    fn checked(&self, premises: Premises) -> Result<TuningSpace> {
        if self.robust && self.space == Preset::Paper {
            return Err(CliError::Usage(
                "--robust goes with the full space; in --space paper it is a parameter: --config robust=true"
                    .to_owned(),
            ));
        }
        Ok(TuningSpace::new(self.space, &premises))
    }
}

/// Where a search begins.
#[derive(Args, Clone, Debug)]
pub struct StartArguments {
    /// Where the search begins, which is what clients get as long as nothing else is known: `recommended`
    /// (the configuration that is best on most scenes), where trees are tuned also `native` (Embree's
    /// default) or `paper` (the paper's default), or a JSON file with your own configuration. Each start has
    /// a study of its own.
    #[arg(long, value_name = "recommended|native|paper|FILE", default_value = "recommended")]
    pub start: String,
}

impl StartArguments {
    /// The start, and the space that begins there.
    pub fn of(&self, space: &TuningSpace) -> Result<(Start, TuningSpace)> {
        let start = match self.start.as_str() {
            "recommended" => Start::Recommended,
            "native" => Start::Native,
            "paper" => Start::Paper,
            file => Start::Own(read_configuration(std::path::Path::new(file))?),
        };
        let begun = space.beginning_at(&start)?;
        if let Start::Own(configuration) = &start {
            note_retired(space, configuration);
        }
        Ok((start, begun))
    }
}

/// Which acceleration structure, and how it is rendered with.
#[derive(Args, Clone, Debug)]
pub struct StructureArguments {
    /// The parameters.
    #[command(flatten)]
    pub space: SpaceArguments,

    /// Parameters, for example `quality=3,branching_factor=8`; others keep their recommended values (see
    /// `treewright-render spaces`).
    #[arg(long, value_name = "NAME=VALUE,…", conflicts_with_all = ["config_file", "native"])]
    pub config: Option<String>,

    /// JSON file with parameters, as written by `tune --json` and `treewright-render best`.
    #[arg(long, value_name = "FILE", conflicts_with = "native")]
    pub config_file: Option<PathBuf>,

    /// Use Embree's own structure, traced path by path with single rays.
    #[arg(long, value_parser = native())]
    pub native: Option<NativeQuality>,
}

impl StructureArguments {
    /// The structure to build and the way to render: the space's default without arguments.
    pub fn choice(&self) -> Result<Choice> {
        let space = self.space.whole(Objective::Render)?;
        if let Some(quality) = self.native {
            let robust = self.space.robust;
            let options = NativeOptions { quality, robust, ..NativeOptions::default() };
            return Ok(BuildChoice::Native(options).into());
        }
        let configuration = match (&self.config, &self.config_file) {
            (Some(text), _) => space::parse(text)?,
            (None, Some(path)) => read_configuration(path)?,
            (None, None) => Configuration::new(),
        };
        let choice = space.choice(&configuration)?;
        note_retired(&space, &configuration);
        Ok(choice)
    }
}

/// Says which parameters of a configuration that was accepted are ignored.
pub fn note_retired(space: &TuningSpace, configuration: &Configuration) {
    for name in space.retired(configuration) {
        eprintln!(
            "note: {name} is ignored: it is no parameter any more, and what was recommended is always done"
        );
    }
}

/// A configuration in a file, with the name it goes by and the space it is of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedConfiguration {
    /// For people.
    pub name: String,
    /// Its space.
    pub preset: Preset,
    /// The JSON file.
    pub path: PathBuf,
}

impl FromStr for NamedConfiguration {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('=').and_then(|(name, rest)| Some((name, rest.split_once(':')?)));
        let wrong = "it is written NAME=SPACE:FILE, for example tuned=full:best.json";
        let (name, (preset, path)) = parts.ok_or(wrong)?;
        let preset = Preset::ALL.into_iter().find(|known| known.name() == preset);
        let preset = preset.ok_or_else(|| format!("{wrong}; spaces are full, paper, light and follow"))?;
        Ok(Self { name: name.to_owned(), preset, path: path.into() })
    }
}

/// Reads a configuration from JSON: an object of parameters, or an object that holds one as `configuration`.
pub fn read_configuration(path: &std::path::Path) -> Result<Configuration> {
    let text = std::fs::read_to_string(path)
        .map_err(|error| CliError::Failed(format!("{} cannot be read: {error}", path.display())))?;
    let wrong = |cause: String| {
        CliError::Failed(format!(
            "{} does not hold a configuration: {cause}; it must be an object like {{\"quality\": 3}}",
            path.display()
        ))
    };
    let mut value: serde_json::Value =
        serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?;
    // `best` writes the one word, and `tune --json` the other.
    if let Some(inner) = ["configuration", "tuned"].iter().find_map(|word| value.get(word)) {
        value = inner.clone();
    }
    serde_json::from_value(value).map_err(|error| wrong(error.to_string()))
}

/// Reads an objective.
pub fn objective() -> impl TypedValueParser<Value = Objective> {
    one_of(Objective::KNOWN.map(|objective| {
        (
            objective,
            objective.name(),
            match objective {
                Objective::Render => "Progressive rendering: a frame pays for a thousandth of its build",
                Objective::Total => "Real-time rendering: a frame pays for a whole build",
                Objective::Error => {
                    "Progressive rendering: time to a picture of little noise, by the sampling of light"
                }
                Objective::Motion => {
                    "A scene that moves: mean frame, with what brings the structure along (see --motion)"
                }
                Objective::Auto(_) => {
                    "A tree that serves some frames: a frame pays for its share of the build (see --frames-per-build)"
                }
            },
        )
    }))
}

fn preset() -> impl TypedValueParser<Value = Preset> {
    one_of(Preset::ALL.map(|preset| {
        (
            preset,
            preset.name(),
            match preset {
                Preset::Full => "Native Embree, the tunable tree, and how rays are grouped",
                Preset::Paper => "The eleven parameters of the paper's Table 1",
                Preset::Light => "How light is looked for, with the recommended tree",
                Preset::Follow => "How structures follow scenes that move",
            },
        )
    }))
}

fn native() -> impl TypedValueParser<Value = NativeQuality> {
    one_of([
        (NativeQuality::Low, "low", "Morton codes: builds fast"),
        (NativeQuality::Medium, "medium", "Binned surface area heuristic: Embree's default"),
        (NativeQuality::High, "high", "With spatial splits: renders fast"),
    ])
}

/// A number from 0 to 1.
pub fn unit_interval(text: &str) -> Result<f32, String> {
    number_within(text, 0.0..=1.0, "a number from 0 to 1")
}

/// Three finite numbers with commas between them.
fn vector(text: &str) -> Result<DVec3, String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|number| number.trim().parse().ok()).collect();
    match (numbers.as_slice(), text.split(',').count()) {
        (&[x, y, z], 3) if DVec3::new(x, y, z).as_vec3().is_finite() => Ok(DVec3::new(x, y, z)),
        _ => Err("it must be three numbers like 1,2.5,-3".to_owned()),
    }
}

fn fov(text: &str) -> Result<f32, String> {
    number_within(text, FOV_RANGE_DEG, "an angle from 0.01 to 170 degrees")
}

fn threads(text: &str) -> Result<usize, String> {
    number_within(text, 0..=THREADS_MAX, &format!("a whole number from 0 to {THREADS_MAX}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_and_angles_are_read_and_refused() {
        assert_eq!(vector("1,-2.5, 3e1"), Ok(DVec3::new(1.0, -2.5, 30.0)));
        for wrong in ["", "1,2", "1,2,3,4", "1,2,x", "1,2,nan", "1,2,inf", "1 2 3"] {
            assert!(vector(wrong).is_err(), "{wrong}");
        }
        assert_eq!(fov("35.5"), Ok(35.5));
        for wrong in ["0", "171", "-30", "x", "nan"] {
            assert!(fov(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn sizes_are_read_and_refused() {
        assert_eq!("640x480".parse(), Ok(Size([640, 480])));
        assert_eq!("1X16384".parse(), Ok(Size([1, 16_384])));
        for wrong in ["", "640", "640x", "x480", "0x4", "4x0", "-4x4", "640x480x2", "99999x4", "4.5x4"] {
            assert!(wrong.parse::<Size>().is_err_and(|message| message.contains("WIDTHxHEIGHT")), "{wrong}");
        }
    }

    #[test]
    fn named_configurations_say_their_space() {
        let named = |name: &str, preset, path: &str| NamedConfiguration {
            name: name.to_owned(),
            preset,
            path: path.into(),
        };
        assert_eq!("tuned=full:a/b:c.json".parse(), Ok(named("tuned", Preset::Full, "a/b:c.json")));
        assert_eq!("paper render=paper:x".parse(), Ok(named("paper render", Preset::Paper, "x")));
        for wrong in ["", "tuned", "tuned=best.json", "tuned=half:best.json"] {
            assert!(
                wrong.parse::<NamedConfiguration>().is_err_and(|message| message.contains("NAME=SPACE:FILE"))
            );
        }
    }

    #[test]
    fn configurations_are_read_from_files() {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let path = folder.path().join("best.json");
        let read = |text: &str| {
            std::fs::write(&path, text).expect("it can be written");
            read_configuration(&path)
        };
        let expected =
            Configuration::new().with("quality", 3).with("traversal_cost", 0.5).with("robust", true);
        let plain = r#"{"quality": 3, "traversal_cost": 0.5, "robust": true}"#;
        assert_eq!(read(plain).ok(), Some(expected.clone()));
        assert_eq!(read(&format!(r#"{{"cost": 1, "configuration": {plain}}}"#)).ok(), Some(expected.clone()));
        let of_tune =
            format!(r#"{{"study": "s", "found": {{"quality": 1}}, "tuned": {plain}, "best": "tuned"}}"#);
        assert_eq!(read(&of_tune).ok(), Some(expected));
        assert!(read("[1, 2]").is_err_and(|error| error.to_string().contains("best.json")));
        assert!(read("{").is_err());
    }
}
