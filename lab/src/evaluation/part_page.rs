//! The paper's section 4 in words, tables and figures, as far as a record holds it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use treewright_client::Configuration;
use treewright_figures::escaped;
use treewright_renderer::{space::TuningSpace, statistics::Summary};

use super::markup::{card, table};
use super::part_figures::{
    PartGain, Run, SHARES, angles, heights, mean_and_band, needles, number, part, splitting, turning_height,
};
use super::parts::{PARTS, came_to};
use super::record::{GroupKind, PartSearch, Record, Versus};
use crate::converge::bootstrap::in_brackets;

/// The page's sections; empty where nothing of the kind was recorded.
pub(crate) fn html(record: &Record, space: &TuningSpace) -> String {
    splitting_section(record) + &parts_section(record, space) + &needles_section(record)
}

fn scenes(record: &Record, wanted: fn(&Versus) -> bool) -> BTreeSet<&str> {
    record.pairs.keys().filter(|(_, versus)| wanted(versus)).map(|(scene, _)| scene.as_str()).collect()
}

fn splitting_section(record: &Record) -> String {
    let scenes: Vec<_> = scenes(record, |versus| matches!(versus, Versus::Height(_)))
        .into_iter()
        .map(|scene| (scene, heights(record, scene)))
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
    text += &card(&splitting(&scenes));
    let mut rows = Vec::new();
    for (scene, heights) in &scenes {
        for (height, [without, with], ratio) in heights {
            let interval = in_brackets(ratio.interval, |end| format!("{end:.3}"));
            let speed = format!("{:.3}{interval}", ratio.median);
            let place = format!("{scene}, {height}");
            rows.push(vec![place, format!("{without:.1}"), format!("{with:.1}"), speed]);
        }
    }
    text += &table(&heads, &rows);
    text += "<ul>";
    for (scene, heights) in &scenes {
        let finding = match turning_height(heights) {
            Some(height) => format!("it begins to pay at {height:.0} pixels down"),
            None if heights.iter().all(|(_, _, ratio)| ratio.median >= 1.0) => {
                "it pays at every height".to_owned()
            }
            None if heights.iter().all(|(_, _, ratio)| ratio.median < 1.0) => {
                "it pays at none of them".to_owned()
            }
            None => "it does not pay from one height on".to_owned(),
        };
        let _ = write!(text, "<li>{}: {finding}.</li>", escaped(scene));
    }
    text + "</ul>"
}

fn by_part(record: &Record) -> BTreeMap<(&'static str, &str), Vec<&PartSearch>> {
    let mut all: BTreeMap<(&'static str, &str), Vec<&PartSearch>> = BTreeMap::new();
    for search in &record.parts {
        if let Some(part) = PARTS.iter().find(|part| part.name == search.part) {
            all.entry((part.name, search.search.place.scene.as_str())).or_default().push(search);
        }
    }
    all
}

fn parts_section(record: &Record, space: &TuningSpace) -> String {
    let all = by_part(record);
    let mut text = String::new();
    for one in PARTS {
        let mut heads = vec![
            "scene",
            "default, ms",
            "gain of the best found",
            "single searches",
            "gain of the last iteration",
            "single searches",
        ];
        heads.extend(one.parameters);
        let (mut rows, mut figures, mut is_whole) = (Vec::new(), String::new(), true);
        for ((_, scene), searches) in all.iter().filter(|((name, _), _)| *name == one.name) {
            let runs: Vec<Run<'_>> = searches.iter().filter_map(|search| Run::of(search)).collect();
            if runs.iter().all(|run| run.points.is_empty()) {
                continue;
            }
            let again = Again::of(record, space, searches);
            is_whole &= again.is_some();
            let mut cells = vec![format!("{scene}, {} searches", runs.len())];
            cells.extend(again.as_ref().map_or_else(Default::default, Again::cells));
            for name in one.parameters {
                let ends = runs.iter().flat_map(Run::end).filter_map(|point| number(point.2, name));
                let Summary { lower_quartile, upper_quartile, .. } = Summary::of(&ends.collect::<Vec<_>>());
                cells.push([lower_quartile, upper_quartile].map(treewright_figures::number).join(" to "));
            }
            rows.push(cells);
            let _ = write!(figures, "<h3>{}</h3>", escaped(scene));
            for svg in part(&one, &runs, again.map(|again| again.default_ms)) {
                figures += &card(&svg);
            }
        }
        if !rows.is_empty() {
            let missing = if is_whole { "" } else { NOT_AGAIN };
            let _ = write!(
                text,
                "<h2>{}</h2><p class=\"soft\">All other parameters at their recommended values. The best that each search found, its last \
                 iteration and the default were measured again in shared, interleaved rounds, each with a fresh build: median of the \
                 geometric mean of the searches over the rounds, its interval of 95 % where there are at least six rounds, and the least and \
                 most of single searches. The middle half of each parameter in the last quarter of the iterations. In the figures one colour \
                 a search, later iterations darker, dashed the recommended default.</p>{missing}{}{figures}",
                one.title,
                table(&heads, &rows)
            );
        }
    }
    text
}

/// The note in place of gains whose costs come from different rounds.
const NOT_AGAIN: &str = "<p class=\"warn\">Gains are left out where the default and what the searches came to were not measured in the \
                         same rounds; <code>evaluate parameters</code> measures them.</p>";

/// The results of the searches over a part in a scene, and the default, measured again in shared rounds.
struct Again {
    default_ms: f64,
    /// Of the best that each found, and of its last iteration.
    gains: [PartGain; 2],
}

impl Again {
    fn of(record: &Record, space: &TuningSpace, searches: &[&PartSearch]) -> Option<Self> {
        let search = &searches.first()?.search;
        let objective = search.minimised()?;
        let group = record.groups.get(&(GroupKind::Parts, search.place.clone()))?;
        let own = searches.iter().filter(|one| one.search.objective == search.objective);
        let found = own.filter_map(|one| came_to(one, space).ok()?);
        let (best, last): (Vec<_>, Vec<_>) = found.map(|[best, last]| (best, last)).unzip();
        let default = space.default_configuration();
        let gain = |found: &[Configuration]| PartGain::of(group, &default, found, objective);
        let default_ms = group.cost(&default, objective)?;
        Some(Self { default_ms, gains: [gain(&best)?, gain(&last)?] })
    }

    fn cells(&self) -> [String; 5] {
        let [[best, of_best], [last, of_last]] = self.gains.map(|gain| gain.words());
        [format!("{:.2}", self.default_ms), best, of_best, last, of_last]
    }
}

/// At how many angles of a scene's round the cylinder was measured, and how many there are.
fn round(record: &Record, scene: &str) -> (usize, usize) {
    let all = record.pairs.keys().filter_map(|(of, versus)| match versus {
        Versus::Needles { angles, .. } if of == scene => Some(*angles as usize),
        _ => None,
    });
    all.fold((0, 0), |(measured, _), angles| (measured + 1, angles))
}

fn needles_section(record: &Record) -> String {
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
    let heads = [
        "scene",
        "build, without",
        "build, with",
        "render, without",
        "render, with",
        "total, without",
        "total, with",
    ];
    let mut rows = Vec::new();
    for scene in &scenes {
        let mut cells = vec![(*scene).to_owned()];
        for share in SHARES {
            let angles = angles(record, scene, share);
            for which in 0..2 {
                let mut means: Vec<f64> =
                    angles.iter().map(|(_, both)| mean_and_band(&both[which]).0).collect();
                means.sort_by(f64::total_cmp);
                let ends = means.first().zip(means.last());
                cells.push(ends.map_or(String::new(), |(low, high)| format!("{low:.1} to {high:.1} ms")));
            }
        }
        rows.push(cells);
    }
    text += &table(&heads, &rows);
    for scene in &scenes {
        let _ = write!(text, "<h3>{}</h3>", escaped(scene));
        for share in SHARES {
            let angles = angles(record, scene, share);
            text += &card(&needles(&angles, share));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::testing::{conditions, group, search};
    use super::super::{parts::compared, record::Line};
    use super::*;

    #[test]
    fn gains_come_from_rounds_that_hold_the_default_or_are_left_out() {
        let space = TuningSpace::paper();
        let leaves = |least: i64, most: i64| {
            Configuration::new().with("min_leaf_size", least).with("max_leaf_size", most)
        };
        let mut record = Record::new(conditions(3));
        for (run, last) in [(0, leaves(4, 10)), (1, leaves(1, 8))] {
            // Its own single measurements say something else: the default was unlucky.
            let tried = [(leaves(1, 32), Some(900.0)), (leaves(1, 8), Some(30.0)), (last, Some(60.0))];
            let search = search("hall", &tried);
            record.take(Line::Part(PartSearch { part: "leaves".to_owned(), run, search }));
        }
        let all = compared(&record, &space, "hall").expect("all are sound");
        assert_eq!(
            (all.len(), &all[0]),
            (3, &space.default_configuration()),
            "the default and two, each once"
        );
        assert!(
            all[1].get("quality").is_some()
                && all[1].get("max_leaf_size") == leaves(1, 8).get("max_leaf_size")
        );
        let page = || html(&record, &space);
        assert!(page().contains("Gains are left out") && !page().contains("+"), "{}", page());
        // The machine becomes slower from round to round.
        let slower = |ms: f64| [1.0, 2.0, 3.0, 4.0, 5.0, 6.0].map(|round| ms * round);
        let rounds = [100.0, 50.0, 200.0].map(slower);
        let measured: Vec<(Configuration, &[f64])> =
            all.into_iter().zip(rounds.iter().map(|rounds| &rounds[..])).collect();
        record.take(Line::Group(group(GroupKind::Parts, "hall", &measured)));
        let page = html(&record, &space);
        assert!(!page.contains("Gains are left out"), "{page}");
        // The best of both searches takes half the time; the last iterations twice as long and half.
        for cell in ["350.00", "+100.0 % [+100.0, +100.0]", "+0.0 % [+0.0, +0.0]", "-50.0 to +100.0 %"] {
            assert!(page.contains(&format!(">{cell}</td>")), "{cell} in {page}");
        }
    }
}
