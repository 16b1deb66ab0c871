//! Maps of states and races of studies.

use treewright_core::cost_view::CostView;

use super::{Axis, COLOURS, Frame, WIDTH, above_zero, escape, figure, nothing, open, open_sized, put, range};

/// A state on a map.
pub(in super::super) struct Place {
    pub(in super::super) state: i64,
    /// Between the ends of the axes, 0 to 1.
    pub(in super::super) x: f64,
    pub(in super::super) y: f64,
    /// The rank that its colour shows: the smaller, the warmer.
    pub(in super::super) rank: f64,
    /// The rank in words.
    pub(in super::super) words: String,
    /// The target of its link.
    pub(in super::super) link: String,
}

/// States by two of their indicators, in five colours by rank.
pub(in super::super) fn map(x_axis: &Axis, y_axis: &Axis, places: &[Place]) -> String {
    if places.is_empty() {
        return nothing("Nothing was measured yet.");
    }
    let mut ranks: Vec<f64> = places.iter().map(|place| place.rank).collect();
    ranks.sort_by(f64::total_cmp);
    ranks.dedup();
    let frame =
        Frame { left: 110.0, top: 24.0, width: 760.0, height: 360.0, x: (-0.03, 1.03), y: (-0.03, 1.03) };
    let mut svg = open(440.0, &format!("States by {} and {}", x_axis.name, y_axis.name));
    put(&mut svg, format_args!(r#"<rect class="axis" x="110" y="24" width="760" height="360"/>"#));
    for (x, y, anchor, words) in [
        (110.0, 402.0, "start", &x_axis.low),
        (870.0, 402.0, "end", &x_axis.high),
        (490.0, 402.0, "middle", &x_axis.name),
        (104.0, 384.0, "end", &y_axis.low),
        (104.0, 34.0, "end", &y_axis.high),
        (110.0, 16.0, "start", &y_axis.name),
    ] {
        let words = escape(words);
        put(&mut svg, format_args!(r#"<text x="{x}" y="{y}" text-anchor="{anchor}">{words}</text>"#));
    }
    for (index, place) in places.iter().enumerate() {
        let class = ranks.partition_point(|other| *other < place.rank) * COLOURS / ranks.len();
        debug_assert!(class < COLOURS, "a rank of {} has no colour", place.rank);
        let (x, y) = (frame.x(place.x), frame.y(place.y));
        let (link, words) = (escape(&place.link), escape(&place.words));
        let state = place.state;
        put(
            &mut svg,
            format_args!(
                r#"<a href="{link}" aria-label="state {state}: {words}"><circle class="c{class}" cx="{x:.1}" cy="{y:.1}" r="8"><title>state {state}: {words}</title></circle>"#
            ),
        );
        // Numbers of states that lie upon each other stand around them.
        let is_near =
            |other: &&Place| (frame.x(other.x) - x).abs() < 24.0 && (frame.y(other.y) - y).abs() < 24.0;
        let (right, down, anchor) = match places[..index].iter().filter(is_near).count() % 4 {
            0 => (0.0, -11.0, "middle"),
            1 => (0.0, 20.0, "middle"),
            2 => (12.0, 4.0, "start"),
            _ => (-12.0, 4.0, "end"),
        };
        let (x, y) = (x + right, y + down);
        put(
            &mut svg,
            format_args!(r#"<text x="{x:.1}" y="{y:.1}" text-anchor="{anchor}">{state}</text></a>"#),
        );
    }
    svg + "</svg>"
}

/// The best so far of one study.
pub(in super::super) struct Runner {
    pub(in super::super) name: String,
    /// Cost over its default's, in the order of the trials.
    pub(in super::super) ratios: Vec<f64>,
    /// Its view of costs.
    pub(in super::super) view: CostView,
}

/// The fall of the best cost so far in several studies, each relative to its own default, which is 1.
pub(in super::super) fn race(runners: &[Runner]) -> String {
    let best: Vec<(&str, Vec<f64>)> = runners
        .iter()
        .map(|runner| {
            let mut lowest = f64::INFINITY;
            let so_far = runner.ratios.iter().map(|ratio| {
                lowest = lowest.min(*ratio);
                lowest
            });
            (runner.name.as_str(), so_far.collect())
        })
        .collect();
    debug_assert!(
        best.iter().all(|(_, line)| line.is_sorted_by(|before, now| before >= now)),
        "the best so far becomes worse"
    );
    let all = best.iter().flat_map(|(_, line)| line.iter().copied()).filter(|ratio| ratio.is_finite());
    let Some((low, _)) = range(all) else { return nothing("Nothing can be compared yet.") };
    let longest = best.iter().map(|(_, line)| line.len()).max().unwrap_or(1);
    let room = 0.06 * (1.0 - low).abs().max(0.01);
    let frame = Frame {
        left: 70.0,
        top: 24.0,
        width: 815.0,
        height: 270.0,
        x: (1.0, longest as f64),
        y: (above_zero(low.min(1.0), room), 1.0 + room),
    };
    let legend = 20.0 * best.len() as f64;
    let mut svg = open_sized(WIDTH, 326.0 + legend, "Best so far over the default, by study");
    frame.axes(&mut svg, "measured trials", "best so far, default = 1");
    let default = frame.y(1.0);
    put(&mut svg, format_args!(r#"<path class="base" d="M70 {default:.1}H885"/>"#));
    for (index, (name, line)) in best.iter().enumerate() {
        let mut path = String::new();
        for (at, ratio) in line.iter().enumerate() {
            let (x, y) = (frame.x((at + 1) as f64), frame.y(*ratio));
            match path.is_empty() {
                true => put(&mut path, format_args!("M{x:.1} {y:.1}")),
                false => put(&mut path, format_args!("H{x:.1}V{y:.1}")),
            }
        }
        // Neighbours on the scale of colours are hard to tell apart.
        let (class, y) = ([0, 4, 2, 3, 1][index % 5], 330.0 + 20.0 * index as f64);
        put(&mut svg, format_args!(r#"<path class="run runner c{class}" d="{path}"/>"#));
        put(&mut svg, format_args!(r#"<path class="run runner c{class}" d="M70 {:.1}h28"/>"#, y - 4.0));
        let reached = line.last().map(|ratio| reached(*ratio, &runners[index].view)).unwrap_or_default();
        put(&mut svg, format_args!(r#"<text x="106" y="{y}">{}: {reached}</text>"#, escape(name)));
    }
    svg + "</svg>"
}

/// The last ratio of a study; for a maximised metric also the best value over the default's.
fn reached(ratio: f64, view: &CostView) -> String {
    match view.is_maximised() {
        true => format!("{} ({} {} times the default’s)", figure(ratio), view.name(), figure(1.0 / ratio)),
        false => figure(ratio),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_shows_each_state_as_a_link() {
        let axis = |name: &str| Axis { name: name.into(), low: "0".into(), high: "1".into() };
        let place = |state, rank| Place {
            state,
            x: 0.5,
            y: 0.5,
            rank,
            words: "<b>".into(),
            link: format!("/studies/a?state={state}"),
        };
        let svg = map(&axis("triangles"), &axis("<i>"), &[place(1, 0.1), place(2, 0.9)]);
        assert_eq!(svg.matches("<a href").count(), 2);
        assert!(!svg.contains("<b>") && !svg.contains("<i>"), "{svg}");
        assert!(map(&axis("x"), &axis("y"), &[]).contains("Nothing"));
    }

    #[test]
    fn a_race_shows_the_best_so_far() {
        let runner = |name: &str, ratios: &[f64], view: &CostView| Runner {
            name: name.into(),
            ratios: ratios.to_vec(),
            view: view.clone(),
        };
        let times = CostView::default();
        let svg = race(&[runner("a", &[1.0, 0.5, 0.7], &times), runner("<b>", &[], &times)]);
        assert!(svg.contains("a: 0.500") && !svg.contains("<b>") && !svg.contains("NaN"), "{svg}");
        let rate = super::super::tests::rate();
        let svg = race(&[runner("a", &[1.0, 0.5, 0.7], &rate)]);
        assert!(svg.contains("a: 0.500 (fps 2 times the default’s)"), "{svg}");
        assert!(race(&[]).contains("Nothing"));
    }
}
