//! Whole sessions in which the geometry changes every N frames and a tree serves those between: with one
//! fixed structure, with the recommended start, with the service and its search, and with what knowing N, or
//! swapping trees, could win.
//!
//! The service is the tuner itself in one study of the objective `auto`, with its default policy, and one for
//! each number of threads. It serves one session after the other, so that later ones profit from earlier
//! ones. Every configuration that it asks for is built and rendered up to three times; then these
//! measurements serve again in turn, each as a frame. A session pays for every frame of its search, and for a
//! build whenever the structure is another than those that were built since the geometry changed. Then all
//! structures that take part run in the same rounds. By every other round the fixed and the best structures
//! are chosen, by the rest all sessions are added up, so that nobody is chosen by luck and judged by it.
//! Waiting for the service is left out: answers are asked for a frame ahead. The service of a run that is
//! split knows less: nothing of worlds that were measured before.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use treewright_accel::BuildChoice;
use treewright_client::{Configuration, Indicators, Policy};
use treewright_core::policy::Policy as DecidedPolicy;
use treewright_core::trial::{Outcome, Rule};
use treewright_core::tuner::{Ask, Tuner};
use treewright_lab::sessions::{Behind, Times, session_ms};
use treewright_lab::worlds::World;
use treewright_render_cli::output;
use treewright_renderer::film::Film;
use treewright_renderer::frame::{FrameTimes, Renderer};
use treewright_renderer::measure::{Conditions, Contender, Measured, Yardstick, interleaved};
use treewright_renderer::space::{Choice, Premises, Preset, TuningSpace, parse};
use treewright_renderer::statistics::Summary;
use treewright_renderer::tuning::objective::{Objective, measurements, specification};
use treewright_renderer::tuning::search::{SearchSetting, trial};
use treewright_renderer::tuning::who::Who;
use treewright_renderer::tuning::workload::Workload;
use treewright_scene::indicators::SceneIndicators;

use crate::{Arguments, Failure, in_summary, record, view};

/// How many frames a tree serves.
const SERVED: [u32; 6] = [1, 4, 16, 64, 256, 1024];

/// Structures that anybody can choose, as changes of the recommended start, which is the first one.
const STRUCTURES: [(&str, &str); 10] = [
    ("quick", ""),
    ("middle", "builder=ploc,search_radius=8,cluster_size=1,collapse=optimal,min_leaf_size=8"),
    (
        "middle, no passes",
        "builder=ploc,search_radius=8,cluster_size=1,collapse=optimal,min_leaf_size=8,reinsertion_passes=0",
    ),
    (
        "middle, by four",
        "builder=ploc,search_radius=8,cluster_size=4,collapse=optimal,min_leaf_size=8,reinsertion_passes=0",
    ),
    ("quick, by two", "builder=ploc,cluster_size=2,min_leaf_size=8"),
    ("quick, one by one", "builder=ploc,search_radius=8,cluster_size=1,min_leaf_size=8"),
    ("binned", "builder=embree,quality=2,min_leaf_size=8"),
    ("native low", "backend=native,native_quality=low"),
    ("native medium", "backend=native,native_quality=medium"),
    ("native high", "backend=native,native_quality=high"),
];
const QUICK: usize = 0;
const MIDDLE: usize = 1;
/// The documentation's choice up to this number of frames is the quick structure.
const QUICK_UP_TO: u32 = 4;
/// Measurements of one configuration in a scene before they serve again.
const MEASURED_MOST: usize = 3;
/// Configurations in a row that cannot be built before a session is given up.
const UNBUILT_MOST: u32 = 100;
/// A configuration of at least this share of a session's frames runs in the rounds.
const SHARE_IN_ROUNDS: u32 = 8;

/// Each against the fixed structure: the best of the scene over all N, the best pair that is swapped
/// ([`Times::swapped_ms`]), and the ceiling, the best for this N.
const COLUMNS: [&str; 8] = [
    "auto's start",
    "quick, middle by N",
    "service with its search",
    "its answers alone",
    "one a scene",
    "swap, N unknown",
    "swap, spare cores",
    "ceiling",
];
const KNOWING: usize = 7;
const SWAPS: [usize; 2] = [5, 6];

/// A configuration in a session.
struct Ran {
    choice: Choice,
    builds: u32,
    frames: u32,
    /// What these took while the service asked for them, in milliseconds.
    live_ms: f64,
}

/// A session with the service.
struct Played {
    /// By the text of each configuration.
    ran: BTreeMap<String, Ran>,
    /// The text of the one that ran at last.
    answer: String,
    /// Frames until the service was done with its search.
    asked: u32,
}

/// Measurements of a configuration, and how often it was asked for.
#[derive(Default)]
struct Known {
    measured: Vec<Option<FrameTimes>>,
    asked: usize,
}

/// A scene, and what is known of the configurations that were asked for there.
struct Stage {
    renderer: Renderer,
    setting: SearchSetting,
    film: Film,
    known: BTreeMap<String, Known>,
}

/// What tables of several runs must have in common.
#[derive(PartialEq, Serialize, Deserialize)]
struct Conduct {
    sessions: [u32; 6],
    rounds: u32,
    width: u32,
    session_frames: u32,
    trials: u32,
    weigh_gain: bool,
    /// By name and text.
    structures: Vec<(String, String)>,
}

/// What was measured in a world.
#[derive(Serialize, Deserialize)]
struct Table {
    world: String,
    scene: String,
    /// Of the common structures, then of the service's answers: by rounds that choose and that judge.
    times: Vec<[Times; 2]>,
    /// For each number of served frames, the session with the service and with its last answer alone, in
    /// milliseconds; `None` for answers that could not be built in the rounds.
    service_ms: Vec<[Option<f64>; 2]>,
    asked: Vec<u32>,
}

impl Stage {
    fn new(world: &World, space: &Arc<TuningSpace>) -> Result<Self, Failure> {
        let scene = &world.moments[0];
        let setting = SearchSetting {
            // Every measurement builds.
            objective: Objective::Auto(1),
            space: Arc::clone(space),
            baseline: space.default_choice(),
            view: view(scene),
            size: world.size,
            frames: 1,
            indicators: Indicators::new(),
        };
        let renderer = Renderer::new(Arc::clone(scene), world.threads)?;
        let mut stage = Self { renderer, setting, film: Film::new(world.size), known: BTreeMap::new() };
        // The first frame of a scene is slower than all others.
        let start = space.default_configuration();
        stage.times(&start);
        stage.known.clear();
        Ok(stage)
    }

    /// A build and a frame of a configuration; `None` where it cannot be built.
    fn times(&mut self, configuration: &Configuration) -> Option<FrameTimes> {
        let known = self.known.entry(configuration.to_string()).or_default();
        if known.measured.len() < MEASURED_MOST {
            let (_, times) = trial(&mut self.renderer, configuration, None, &self.setting, &mut self.film);
            known.measured.push(times);
        }
        known.asked += 1;
        known.measured[(known.asked - 1) % known.measured.len()]
    }

    /// The next configuration of the service that can be built, its times, and whether the service is done.
    fn next(
        &mut self,
        tuner: &mut Tuner,
        ask: &Ask,
        served: u32,
    ) -> Result<(Configuration, FrameTimes, bool), Failure> {
        for _ in 0..UNBUILT_MOST {
            let (open, _change) = tuner.suggest(ask, 0)?;
            let is_done = open.decision.rule() == Some(Rule::Finished);
            let configuration: Configuration = open.configuration.to_raw().into();
            let times = self.times(&configuration);
            let measured = measurements(times, 1, Objective::Auto(served));
            let measured = measured.iter().map(|(name, value)| (name.to_owned(), value)).collect();
            let outcome = match times {
                Some(_) => Outcome::Ok,
                None => Outcome::infeasible("it cannot be built"),
            };
            let (_reported, _change) = tuner.report(&open, measured, outcome, 0)?;
            if let Some(times) = times {
                return Ok((configuration, times.undelayed(), is_done));
            }
        }
        Err("the service asks for nothing that can be built".into())
    }

    /// A session of `frames` frames in which a tree serves `served` of them.
    fn play(&mut self, tuner: &mut Tuner, ask: &Ask, served: u32, frames: u32) -> Result<Played, Failure> {
        let mut played = Played { ran: BTreeMap::new(), answer: String::new(), asked: 0 };
        // All that were built since the geometry changed.
        let mut trees: Vec<BuildChoice> = Vec::new();
        let mut settled: Option<(Configuration, FrameTimes)> = None;
        for frame in 0..frames {
            if frame.is_multiple_of(served) {
                trees.clear();
            }
            let (configuration, times) = match settled.clone() {
                Some(settled) => settled,
                None => {
                    let (configuration, times, is_done) = self.next(tuner, ask, served)?;
                    played.asked += 1;
                    settled = is_done.then(|| (configuration.clone(), times));
                    (configuration, times)
                }
            };
            let choice = self.setting.space.choice(&configuration)?;
            played.answer = configuration.to_string();
            let begun = Ran { choice, builds: 0, frames: 0, live_ms: 0.0 };
            let ran = played.ran.entry(played.answer.clone()).or_insert(begun);
            if !trees.contains(&choice.build) {
                trees.push(choice.build);
                ran.builds += 1;
                ran.live_ms += times.build_ms;
            }
            ran.frames += 1;
            ran.live_ms += times.render_ms;
        }
        Ok(played)
    }

    /// These choices in the same rounds: each one's times by every other round, and by the rest.
    fn rounds(&mut self, choices: &[Choice], rounds: u32) -> Vec<[Times; 2]> {
        let who = |number: usize| Who::Named(number.to_string().into());
        let contender = |(number, choice): (usize, &Choice)| Contender { who: who(number), choice: *choice };
        let contenders: Vec<Contender> = choices.iter().enumerate().map(contender).collect();
        let SearchSetting { view, size, .. } = self.setting;
        let [.., frames_per_build] = SERVED;
        let conditions = Conditions { view, size, rounds, frames_per_build, yardstick: Yardstick::Frame };
        interleaved(&mut self.renderer, &contenders, &conditions, || true).iter().map(halves).collect()
    }
}

impl Table {
    /// The session with one structure, in milliseconds; `half` is 0 for the rounds that choose, else 1.
    fn session_ms(&self, structure: usize, served: u32, half: usize, frames: u32) -> f64 {
        session_ms(frames, served, |stretch| self.times[structure][half].serves_ms(stretch))
    }

    /// The session with one structure that gives way to another.
    fn swapped_ms(
        &self,
        [quick, better]: [usize; 2],
        behind: Behind,
        served: u32,
        half: usize,
        frames: u32,
    ) -> f64 {
        let [quick, better] = [quick, better].map(|structure| self.times[structure][half]);
        session_ms(frames, served, |stretch| quick.swapped_ms(better, stretch, behind))
    }

    /// Milliseconds of the sessions in the order of [`COLUMNS`], for one of the numbers of served frames.
    fn compared_ms(&self, place: usize, frames: u32) -> [f64; 8] {
        let served = SERVED[place];
        let count = self.times.len();
        let alone = |structure| self.session_ms(structure, served, 1, frames);
        let over_all = |ms: &dyn Fn(u32) -> f64| SERVED.iter().map(|served| ms(*served).ln()).sum::<f64>();
        let one = least(0..count, |at| over_all(&|served| self.session_ms(*at, served, 0, frames)));
        let pairs = || (0..count).flat_map(move |quick| (0..count).map(move |better| [quick, better]));
        let swapped = |behind| {
            let mean =
                |pair: &[usize; 2]| over_all(&|served| self.swapped_ms(*pair, behind, served, 0, frames));
            self.swapped_ms(least(pairs(), mean), behind, served, 1, frames)
        };
        let [service, answers] = self.service_ms[place].map(|ms| ms.unwrap_or(f64::INFINITY));
        [
            alone(QUICK),
            alone(if served <= QUICK_UP_TO { QUICK } else { MIDDLE }),
            service,
            answers,
            alone(one),
            swapped(Behind::SameCores),
            swapped(Behind::SpareCores),
            alone(least(0..count, |at| self.session_ms(*at, served, 0, frames))),
        ]
    }
}

/// The medians of every other round, and of the rest.
fn halves(measured: &Measured) -> [Times; 2] {
    [0, 1].map(|half| {
        let of = |which: fn(&FrameTimes) -> f64| {
            let every_other = measured.frames.iter().skip(half).step_by(2);
            Summary::of(&every_other.map(|times| which(&times.undelayed())).collect::<Vec<_>>()).median
        };
        match measured.failure {
            Some(_) => Times::NONE,
            None => Times { build_ms: of(|times| times.build_ms), frame_ms: of(|times| times.render_ms) },
        }
    })
}

/// The one of some that costs the least.
fn least<T: Default>(all: impl Iterator<Item = T>, cost: impl Fn(&T) -> f64) -> T {
    all.min_by(|a, b| cost(a).total_cmp(&cost(b))).unwrap_or_default()
}

/// The one structure for all: the best in the geometric mean over all other worlds and served frames.
fn fixed(tables: &[Table], common: usize, frames: u32, of: (usize, usize)) -> usize {
    let pairs = || (0..tables.len()).flat_map(|world| (0..SERVED.len()).map(move |place| (world, place)));
    let mean = |structure: &usize| {
        let others = pairs().filter(|pair| *pair != of);
        let cost = |(world, place): (usize, usize)| {
            tables[world].session_ms(*structure, SERVED[place], 0, frames).ln()
        };
        others.map(cost).sum::<f64>()
    };
    least(0..common, mean)
}

/// All sessions of a world, and then the rounds.
fn measured(
    world: World,
    tuner: &mut Tuner,
    common: &[Configuration],
    (space, arguments): (&Arc<TuningSpace>, &Arguments),
) -> Result<Table, Failure> {
    let mut stage = Stage::new(&world, space)?;
    let scene = &world.moments[0];
    let frames = arguments.session_frames;
    let seen = SceneIndicators::of(scene).with_camera(&stage.setting.view.camera);
    let workload = Workload::of(scene, world.size, stage.setting.view.bounces);
    let mut sessions = Vec::new();
    for served in SERVED {
        let state = Workload { frames_per_build: Some(served), ..workload }.state(&seen);
        let indicators = state.iter().map(|(name, value)| (name.to_owned(), value)).collect();
        let ask = Ask { client_id: "levers".to_owned(), indicators, ..Ask::default() };
        let played = stage.play(tuner, &ask, served, frames)?;
        eprintln!("{}, {served} frames a build: done after {} frames", world.name, played.asked);
        sessions.push(played);
    }
    let mut choices =
        common.iter().map(|configuration| space.choice(configuration)).collect::<Result<Vec<_>, _>>()?;
    let texts = common.iter().map(ToString::to_string);
    let mut places: BTreeMap<String, usize> = texts.enumerate().map(|(at, text)| (text, at)).collect();
    for played in &sessions {
        for (text, ran) in &played.ran {
            let counts = ran.frames >= frames / SHARE_IN_ROUNDS || *text == played.answer;
            if counts {
                places.entry(text.clone()).or_insert_with(|| {
                    choices.push(ran.choice);
                    choices.len() - 1
                });
            }
        }
    }
    let times = stage.rounds(&choices, arguments.rounds);
    let judged = |text: &String| places.get(text).map(|at| times[*at][1]);
    let service_ms = SERVED.into_iter().zip(&sessions).map(|(served, played)| {
        let cost = |(text, ran): (&String, &Ran)| match judged(text) {
            Some(one) => f64::from(ran.builds) * one.build_ms + f64::from(ran.frames) * one.frame_ms,
            None => ran.live_ms,
        };
        let answer = judged(&played.answer).unwrap_or(Times::NONE);
        let alone_ms = session_ms(frames, served, |stretch| answer.serves_ms(stretch));
        [played.ran.iter().map(cost).sum::<f64>(), alone_ms].map(|ms| Some(ms).filter(|ms| ms.is_finite()))
    });
    let service_ms = service_ms.collect();
    let asked = sessions.iter().map(|played| played.asked).collect();
    Ok(Table { world: world.name, scene: world.scene, times, service_ms, asked })
}

/// One line for each number of served frames in a world, as soon as it is measured.
fn print_world(table: &Table, frames: u32) {
    println!("{}", table.world);
    for (place, served) in SERVED.into_iter().enumerate() {
        let compared_s = table.compared_ms(place, frames).map(|ms| ms / 1e3);
        let [start, _, service, .., best] = compared_s;
        println!("  N {served:4}: start {start:8.2} s, service {service:8.2} s, best {best:8.2} s");
    }
}

/// One line for each world and number of served frames, then all of them together.
fn print(tables: &[Table], names: &[&str], frames: u32) {
    let mut heading = vec!["world", "N", "fixed", "its session, s"];
    heading.extend(COLUMNS);
    heading.push("frames asked");
    let mut table = output::table(&heading);
    let (mut scenes, mut over_fixed) = (Vec::new(), Vec::new());
    let mut over_knowing = Vec::new();
    for (number, world) in tables.iter().enumerate() {
        for (place, served) in SERVED.into_iter().enumerate() {
            let fixed = fixed(tables, names.len(), frames, (number, place));
            let fixed_ms = world.session_ms(fixed, served, 1, frames);
            let compared_ms = world.compared_ms(place, frames);
            let ratios = compared_ms.map(|ms| fixed_ms / ms);
            let mut row = vec![world.world.clone(), served.to_string(), names[fixed].to_owned()];
            row.push(format!("{:.1}", fixed_ms / 1e3));
            row.extend(ratios.iter().map(|ratio| format!("{ratio:.3}")));
            row.push(world.asked[place].to_string());
            table.add_row(row);
            scenes.push(world.scene.clone());
            over_fixed.push(ratios);
            over_knowing.push(SWAPS.map(|swap| compared_ms[KNOWING] / compared_ms[swap]));
        }
    }
    println!("{frames} frames, of which a tree serves N; speed over the one fixed structure\n{table}");
    for (column, title) in COLUMNS.into_iter().enumerate() {
        let values: Vec<f64> = over_fixed.iter().map(|ratios| ratios[column]).collect();
        in_summary(&format!("{title}, over one fixed structure"), &values, &scenes);
    }
    for (number, swap) in SWAPS.into_iter().enumerate() {
        let values: Vec<f64> = over_knowing.iter().map(|ratios| ratios[number]).collect();
        in_summary(&format!("{}, over the best structure of each N", COLUMNS[swap]), &values, &scenes);
    }
}

/// Plays sessions in all worlds, and prints what they took.
pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let premises = |builds_each_frame| Premises { builds_each_frame, ..Premises::all() };
    let begins_cheap = Objective::Auto(1).begins_with_cheap_builds();
    let space = Arc::new(TuningSpace::new(Preset::Full, &premises(begins_cheap)));
    let (mut names, mut common) = (Vec::new(), Vec::new());
    for (name, text) in STRUCTURES {
        names.push(name);
        common.push(space.complete(&parse(text)?)?);
    }
    names.push("good");
    let stills = TuningSpace::new(Preset::Full, &premises(false));
    common.push(space.complete(&stills.default_configuration())?);
    let &Arguments { rounds, width, session_frames, trials, weigh_gain, .. } = arguments;
    let texts = common.iter().map(ToString::to_string);
    let structures = names.iter().map(|name| (*name).to_owned()).zip(texts).collect();
    let sessions = SERVED;
    let conduct = Conduct { sessions, rounds, width, session_frames, trials, weigh_gain, structures };
    let policy = DecidedPolicy { trials_per_state: trials, weigh_gain, ..DecidedPolicy::default() };
    let study = specification(&space, Objective::Auto(1), Policy::new())?.with_policy(policy);
    let study = Arc::new(study);
    let mut tuners = BTreeMap::new();
    let mut tables = record::measured_before(arguments, &conduct, |table: &Table| table.world.as_str())?;
    for written in &arguments.worlds {
        if tables.iter().any(|table| table.world == written.name()) {
            continue;
        }
        let world = written.load(arguments.frames, width)?;
        let tuner = match tuners.entry(world.threads) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(place) => place.insert(Tuner::new(Arc::clone(&study))?),
        };
        let table = measured(world, tuner, &common, (&space, arguments))?;
        record::keep(arguments, &table)?;
        print_world(&table, session_frames);
        tables.push(table);
    }
    if tables.is_empty() {
        return Err("--lever sessions wants a world".into());
    }
    print(&tables, &names, session_frames);
    Ok(())
}
