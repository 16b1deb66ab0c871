//! Sessions in which the geometry changes every N frames, rendered from the first frame to the last: with one
//! structure for all, and with a quick tree first that a better one, built behind the frames, replaces.
//!
//! Nothing here is added up from measured builds and frames, as in [`sessions`](crate::sessions). Each way
//! renders each session once a round, one way after the other, with all builds before and beside its frames.
//! No tuner takes part.

use std::time::Instant;

use serde::{Deserialize, Serialize};
use treewright_lab::worlds::World;
use treewright_render_cli::output;
use treewright_renderer::film::Film;
use treewright_renderer::frame::{Renderer, milliseconds};
use treewright_renderer::integrator::View;
use treewright_renderer::space::{Choice, Premises, Preset, TuningSpace};
use treewright_renderer::statistics::Summary;
use treewright_renderer::swap::{Came, Swapper};

use crate::{Arguments, Failure, in_summary, record, view};

/// How many frames a tree serves.
const SERVED: [u32; 5] = [1, 4, 16, 64, 256];

/// Structures that serve alone, and the two that are swapped.
const WAYS: [&str; 3] = ["quick", "good", "swapped"];
const SWAPPED: usize = 2;

#[derive(PartialEq, Serialize, Deserialize)]
struct Conduct {
    served: [u32; 5],
    rounds: u32,
    width: u32,
    session_frames: u32,
}

/// What was measured in a world.
#[derive(Serialize, Deserialize)]
struct Table {
    world: String,
    scene: String,
    /// For each number of served frames and each way, the milliseconds of its sessions, one a round.
    session_ms: Vec<[Vec<f64>; 3]>,
    /// The slowest frame of the session with its build, in milliseconds: the median of the rounds.
    slowest_ms: Vec<[f64; 3]>,
    /// Swaps in all sessions of a number of served frames.
    swaps: Vec<u32>,
}

/// A session: its time and its slowest frame, in milliseconds, and its swaps.
struct Session {
    ms: f64,
    slowest_ms: f64,
    swaps: u32,
}

struct Stage {
    renderer: Renderer,
    view: View,
    film: Film,
    alone: [Choice; 2],
}

impl Stage {
    fn new(world: &World) -> Result<Self, Failure> {
        let scene = &world.moments[0];
        let alone = [true, false].map(|builds_each_frame| {
            TuningSpace::new(Preset::Full, &Premises { builds_each_frame, ..Premises::all() })
                .default_choice()
        });
        let renderer = Renderer::new(scene.clone(), world.threads)?;
        Ok(Self { renderer, view: view(scene), film: Film::new(world.size), alone })
    }

    /// A session of `frames` frames in which the geometry changes before every `served`-th.
    fn session(
        &mut self,
        frames: u32,
        served: u32,
        mut begin_frame: impl FnMut(&mut Self, bool) -> Result<bool, Failure>,
        mut render: impl FnMut(&mut Self),
    ) -> Result<Session, Failure> {
        let begin = Instant::now();
        let mut session = Session { ms: 0.0, slowest_ms: 0.0, swaps: 0 };
        for number in 0..frames {
            let frame = Instant::now();
            session.swaps += u32::from(begin_frame(self, number % served == 0)?);
            self.film.clear();
            render(self);
            session.slowest_ms = session.slowest_ms.max(milliseconds(frame));
        }
        session.ms = milliseconds(begin);
        Ok(session)
    }

    fn alone(&mut self, choice: Choice, frames: u32, served: u32) -> Result<Session, Failure> {
        let begin_frame = |stage: &mut Self, changed| {
            if changed {
                stage.renderer.rebuild(&choice.build)?;
            }
            Ok(false)
        };
        self.session(frames, served, begin_frame, |stage| {
            stage.renderer.render(&stage.view, &choice.render, &mut stage.film);
        })
    }

    fn swapped(&mut self, swapper: &mut Swapper, frames: u32, served: u32) -> Result<Session, Failure> {
        let [_, good] = self.alone;
        let swapper = std::cell::RefCell::new(swapper);
        let begin_frame = |stage: &mut Self, changed| {
            let mut swapper = swapper.borrow_mut();
            if changed {
                swapper.begin_again();
            }
            Ok(matches!(swapper.begin_frame(&mut stage.renderer, &good)?, Came::Swapped(_)))
        };
        self.session(frames, served, begin_frame, |stage| {
            swapper.borrow_mut().render(&stage.renderer, &stage.view, &mut stage.film);
        })
    }
}

fn measured(world: World, arguments: &Arguments) -> Result<Table, Failure> {
    let mut stage = Stage::new(&world)?;
    let frames = arguments.session_frames;
    let [quick, good] = stage.alone;
    stage.alone(good, 3, 1)?;
    // As in a renderer, what was learnt in one session serves in the next.
    let mut swapper = Swapper::new(&stage.renderer, quick)?;
    let mut table = Table {
        world: world.name,
        scene: world.scene,
        session_ms: Vec::new(),
        slowest_ms: Vec::new(),
        swaps: Vec::new(),
    };
    for served in SERVED {
        let (mut session_ms, mut slowest_ms) = ([const { Vec::new() }; 3], [const { Vec::new() }; 3]);
        let mut swaps = 0;
        for _ in 0..arguments.rounds {
            let sessions = [
                stage.alone(quick, frames, served)?,
                stage.alone(good, frames, served)?,
                stage.swapped(&mut swapper, frames, served)?,
            ];
            for (way, session) in sessions.into_iter().enumerate() {
                session_ms[way].push(session.ms);
                slowest_ms[way].push(session.slowest_ms);
                swaps += session.swaps;
            }
            // Else it would slow down the next session.
            swapper.wait();
        }
        eprintln!("{}, {served} frames a build: {swaps} swaps", table.world);
        table.session_ms.push(session_ms);
        table.slowest_ms.push(slowest_ms.map(|ms| Summary::of(&ms).median));
        table.swaps.push(swaps);
    }
    Ok(table)
}

impl Table {
    /// The median session of a way, in milliseconds.
    fn median_ms(&self, place: usize, way: usize) -> f64 {
        Summary::of(&self.session_ms[place][way]).median
    }
}

fn print(tables: &[Table], frames: u32) {
    let (mut scenes, mut over_alone) = (Vec::new(), [Vec::new(), Vec::new()]);
    let mut over_either = Vec::new();
    let mut rows = output::table(&[
        "world",
        "N",
        "quick, s",
        "good, s",
        "swapped, s",
        "swaps a session",
        "slowest frame: quick, ms",
        "good",
        "swapped",
    ]);
    for table in tables {
        for (place, served) in SERVED.into_iter().enumerate() {
            let ms = [0, 1, 2].map(|way| table.median_ms(place, way));
            let rounds = table.session_ms[place][SWAPPED].len();
            let mut row = vec![table.world.clone(), served.to_string()];
            row.extend(ms.map(|ms| format!("{:.2}", ms / 1e3)));
            row.push(format!("{:.1}", f64::from(table.swaps[place]) / rounds as f64));
            row.extend(table.slowest_ms[place].map(|ms| format!("{ms:.0}")));
            rows.add_row(row);
            scenes.push(table.scene.clone());
            for (alone, ratios) in over_alone.iter_mut().enumerate() {
                ratios.push(ms[alone] / ms[SWAPPED]);
            }
            over_either.push(ms[0].min(ms[1]) / ms[SWAPPED]);
        }
    }
    println!("{frames} frames, of which a tree serves N; medians of whole sessions\n{rows}");
    for (alone, ratios) in over_alone.iter().enumerate() {
        in_summary(&format!("swapped, over {} alone", WAYS[alone]), ratios, &scenes);
    }
    in_summary("swapped, over the better of the two for each N", &over_either, &scenes);
}

/// Renders sessions in all worlds, and prints what they took.
pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let &Arguments { rounds, width, session_frames, .. } = arguments;
    let conduct = Conduct { served: SERVED, rounds, width, session_frames };
    let mut tables = record::measured_before(arguments, &conduct, |table: &Table| table.world.as_str())?;
    for written in &arguments.worlds {
        if tables.iter().any(|table| table.world == written.name()) {
            continue;
        }
        let table = measured(written.load(arguments.frames, width)?, arguments)?;
        record::keep(arguments, &table)?;
        tables.push(table);
    }
    if tables.is_empty() {
        return Err("--lever swap wants a world".into());
    }
    print(&tables, session_frames);
    Ok(())
}
