//! The paper's section 4 in words, tables and figures, as far as a record holds it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use treewright_renderer::space::TuningSpace;
use treewright_renderer::statistics::Summary;

use super::part_figures::{
    Run, Share, angles, heights, mean_and_band, needles, number, part, splitting, turning_height,
};
use super::parts::PARTS;
use super::plot::{self, escaped, legend};
use super::record::{Clock, PartSearch, Record, Versus};

/// Colours of scenes where several share a figure.
const COLOURS: [&str; 8] = ["c0", "c1", "c3", "c4", "c6", "c7", "c5", "c2"];

/// Moving pictures by scene, as PNG: frames one below the other.
pub(crate) type Strips = BTreeMap<String, Vec<u8>>;

/// The page's sections; empty where nothing of the kind was recorded.
pub(crate) fn html(record: &Record, space: &TuningSpace, clock: Clock, strips: &Strips) -> String {
    splitting_section(record, clock)
        + &parts_section(record, space, clock)
        + &needles_section(record, clock, strips)
}

fn scenes(record: &Record, wanted: fn(&Versus) -> bool) -> BTreeSet<&str> {
    record.pairs.keys().filter(|(_, versus)| wanted(versus)).map(|(scene, _)| scene.as_str()).collect()
}

fn head(cells: &[&str]) -> String {
    let cells: String = cells.iter().map(|cell| format!("<th>{cell}</th>")).collect();
    format!("<div class=\"card\"><table><tr>{cells}</tr>")
}

fn row(heads: &[&str], cells: &[String]) -> String {
    let named = heads.iter().zip(cells).enumerate();
    let cells: String = named
        .map(|(place, (head, cell))| {
            let name = if place == 0 { String::new() } else { format!(" data-l=\"{head}\"") };
            format!("<td{name}>{}</td>", escaped(cell))
        })
        .collect();
    format!("<tr>{cells}</tr>")
}

fn splitting_section(record: &Record, clock: Clock) -> String {
    let scenes: Vec<_> = scenes(record, |versus| matches!(versus, Versus::Height(_)))
        .into_iter()
        .map(|scene| (scene, heights(record, scene, clock)))
        .filter(|(_, heights)| !heights.is_empty())
        .collect();
    if scenes.is_empty() {
        return String::new();
    }
    let heads = ["scene and height", "without, ms", "with splitting, ms", "speed with over without"];
    let mut text = "<h2>Splitting pays when frames are large (section 4.1)</h2><p class=\"soft\">Total time of a frame with \
                    the recommended build, without and with splitting of triangles, in interleaved rounds; medians, and the interval \
                    of 95 % of the median ratio where there are rounds enough.</p>"
        .to_owned();
    let names: Vec<(&str, &str)> =
        scenes.iter().map(|(scene, _)| *scene).zip(COLOURS.into_iter().cycle()).collect();
    text += &legend(&names);
    let _ = write!(text, "<div class=\"card\">{}</div>", splitting(&scenes, &COLOURS));
    text += &head(&heads);
    for (scene, heights) in &scenes {
        for (height, [without, with], ratio) in heights {
            let interval = ratio.interval.map(|[low, high]| format!(" [{low:.3}, {high:.3}]"));
            let speed = format!("{:.3}{}", ratio.median, interval.unwrap_or_default());
            let cells = [format!("{scene}, {height}"), format!("{without:.1}"), format!("{with:.1}"), speed];
            text += &row(&heads, &cells);
        }
    }
    text += "</table></div><ul>";
    for (scene, heights) in &scenes {
        let told = match turning_height(heights) {
            Some(height) => format!("it begins to pay at {height:.0} pixels down"),
            None if heights.iter().all(|(_, _, ratio)| ratio.median >= 1.0) => {
                "it pays at every height".to_owned()
            }
            None if heights.iter().all(|(_, _, ratio)| ratio.median < 1.0) => {
                "it pays at none of them".to_owned()
            }
            None => "it does not pay from one height on".to_owned(),
        };
        let _ = write!(text, "<li>{}: {told}.</li>", escaped(scene));
    }
    text + "</ul>"
}

/// Searches of each part and scene.
fn by_part(record: &Record) -> BTreeMap<(&'static str, &str), Vec<&PartSearch>> {
    let mut all: BTreeMap<(&'static str, &str), Vec<&PartSearch>> = BTreeMap::new();
    for search in &record.parts {
        if let Some(part) = PARTS.iter().find(|part| part.name == search.part) {
            all.entry((part.name, search.search.place.scene.as_str())).or_default().push(search);
        }
    }
    all
}

fn parts_section(record: &Record, space: &TuningSpace, clock: Clock) -> String {
    let all = by_part(record);
    let mut text = String::new();
    for one in PARTS {
        let Ok(own_space) = one.space(space) else { continue };
        let default = own_space.default_configuration();
        let mut heads = vec!["scene", "default, ms", "where searches end, ms", "gain"];
        heads.extend(one.parameters);
        let (mut rows, mut figures) = (String::new(), String::new());
        for ((_, scene), searches) in all.iter().filter(|((name, _), _)| *name == one.name) {
            let runs: Vec<Run<'_>> = searches.iter().filter_map(|search| Run::of(search, clock)).collect();
            let points = || runs.iter().flat_map(|run| &run.points);
            let of_default: Vec<f64> =
                points().filter(|point| *point.2 == default).map(|point| point.1).collect();
            let default_ms = (!of_default.is_empty()).then(|| Summary::of(&of_default).median);
            let ends: Vec<f64> = runs.iter().flat_map(Run::end).map(|point| point.1).collect();
            if ends.is_empty() {
                continue;
            }
            let end_ms = Summary::of(&ends).median;
            let mut cells = vec![
                format!("{scene}, {} searches", runs.len()),
                default_ms.map_or("not measured".to_owned(), |ms| format!("{ms:.2}")),
                format!("{end_ms:.2}"),
                default_ms.map_or(String::new(), |ms| format!("{:.1} %", (ms / end_ms - 1.0) * 100.0)),
            ];
            for name in one.parameters {
                let ends = runs.iter().flat_map(Run::end).filter_map(|point| number(point.2, name));
                let Summary { lower_quartile, upper_quartile, .. } = Summary::of(&ends.collect::<Vec<_>>());
                cells.push(format!("{} to {}", plot::number(lower_quartile), plot::number(upper_quartile)));
            }
            rows += &row(&heads, &cells);
            let _ = write!(figures, "<h3>{}</h3>", escaped(scene));
            for svg in part(&one, &runs, default_ms) {
                let _ = write!(figures, "<div class=\"card\">{svg}</div>");
            }
        }
        if !rows.is_empty() {
            let _ = write!(
                text,
                "<h2>{}</h2><p class=\"soft\">All other parameters at their recommended values; one colour a search, later iterations \
                 darker, dashed the recommended default. A search's end is the last quarter of its iterations: median of their times, \
                 and the middle half of their values.</p>{}{rows}</table></div>{figures}",
                one.title,
                head(&heads)
            );
        }
    }
    text
}

/// At how many angles of a scene's round the cylinder was measured, and how many there are.
fn round(record: &Record, scene: &str) -> (usize, usize) {
    let all = record.pairs.keys().filter_map(|(of, versus)| match versus {
        Versus::Needles { angles, .. } if of == scene => Some(*angles as usize),
        _ => None,
    });
    all.fold((0, 0), |(measured, _), angles| (measured + 1, angles))
}

fn needles_section(record: &Record, clock: Clock, strips: &Strips) -> String {
    let begun = scenes(record, |versus| matches!(versus, Versus::Needles { .. }));
    if begun.is_empty() {
        return String::new();
    }
    let (scenes, stopped): (Vec<&str>, Vec<&str>) = begun.into_iter().partition(|scene| {
        let (measured, angles) = round(record, scene);
        measured == angles
    });
    let mut text = "<h2>A cylinder of needles turns through each scene (Figure 9)</h2><p class=\"soft\">Half as long as the scene's \
                    diagonal, through its middle. Mean of the rounds at each angle, with and without splitting; the areas are where the \
                    true means lie with 99.99 %.</p>"
        .to_owned();
    for scene in stopped {
        let (measured, angles) = round(record, scene);
        let _ = write!(
            text,
            "<p class=\"warn\">{}: {measured} of {angles} angles were measured. A round that was stopped is not shown.</p>",
            escaped(scene)
        );
    }
    if scenes.is_empty() {
        return text;
    }
    text += &legend(&[("without splitting", "c3"), ("with splitting", "c4")]);
    let heads = [
        "scene",
        "build, without",
        "build, with",
        "render, without",
        "render, with",
        "total, without",
        "total, with",
    ];
    text += &head(&heads);
    for scene in &scenes {
        let mut cells = vec![(*scene).to_owned()];
        for share in Share::ALL {
            let angles = angles(record, scene, share, clock);
            for which in 0..2 {
                let mut means: Vec<f64> =
                    angles.iter().map(|(_, both)| mean_and_band(&both[which]).0).collect();
                means.sort_by(f64::total_cmp);
                let ends = means.first().zip(means.last());
                cells.push(ends.map_or(String::new(), |(low, high)| format!("{low:.1} to {high:.1} ms")));
            }
        }
        text += &row(&heads, &cells);
    }
    text += "</table></div>";
    for scene in &scenes {
        let _ = write!(text, "<h3>{}</h3>", escaped(scene));
        if let Some(strip) = strips.get(*scene) {
            text += &moving(strip, scene);
        }
        for share in Share::ALL {
            let angles = angles(record, scene, share, clock);
            let _ = write!(text, "<div class=\"card\">{}</div>", needles(&angles, share));
        }
    }
    text
}

/// A strip of frames that moves up behind a window, frame by frame; it stands still for who asks for less
/// motion. The window is as high as a frame of four across to three down.
fn moving(strip: &[u8], scene: &str) -> String {
    let Some(frames) = frames(strip) else { return String::new() };
    format!(
        "<div class=\"card\"><div class=\"strip\" role=\"img\" aria-label=\"the cylinder turning through {}\" \
         style=\"animation-timing-function:steps({frames},jump-none);background-size:100% {frames}00%;\
         background-image:url(data:image/png;base64,{})\"></div></div>",
        escaped(scene),
        STANDARD.encode(strip)
    )
}

/// Frames of four across to three down in a strip, by the size that a PNG's first chunk tells.
fn frames(strip: &[u8]) -> Option<u32> {
    let edge = |at: usize| Some(u32::from_be_bytes(strip.get(at..at + 4)?.try_into().ok()?));
    let (width, height) = (edge(16)?, edge(20)?);
    (width >= 4).then(|| height / (width * 3 / 4)).filter(|frames| *frames > 1)
}

/// The numbers behind the figures: file names and contents.
pub(crate) fn tables(record: &Record, clock: Clock) -> BTreeMap<String, String> {
    let mut files = BTreeMap::new();
    if !record.parts.is_empty() {
        let mut text = String::from("part,scene,run,objective,iteration,cost_ms,configuration\n");
        for search in &record.parts {
            let Some(run) = Run::of(search, clock) else { continue };
            let (part, scene, objective) = (&search.part, &search.search.place.scene, run.objective.name());
            for (iteration, cost_ms, configuration) in &run.points {
                let _ = writeln!(
                    text,
                    "{part},{scene},{},{objective},{iteration},{cost_ms:.4},\"{configuration}\"",
                    run.run + 1
                );
            }
        }
        files.insert("parts.csv".to_owned(), text);
    }
    let mut text = String::from("scene,height,angle,angles,splitting,round,build_ms,render_ms\n");
    for ((scene, versus), group) in &record.pairs {
        let versus = match versus {
            Versus::Height(height) => format!("{height},,"),
            Versus::Needles { angle, angles } => format!(",{angle},{angles}"),
        };
        for (member, splitting) in group.members.iter().zip(["without", "with"]) {
            for (round, times) in member.rounds.iter().enumerate() {
                if let Some([build_ms, render_ms]) = clock.read(times) {
                    let _ = writeln!(
                        text,
                        "{scene},{versus},{splitting},{},{build_ms:.4},{render_ms:.4}",
                        round + 1
                    );
                }
            }
        }
    }
    if !record.pairs.is_empty() {
        files.insert("splitting.csv".to_owned(), text);
    }
    files
}
