//! The page of an ablation: bars for each parameter's gain in the winner and for its gain alone.

use askama::Template;
use serde::Serialize;
use treewright_client::Configuration;

use treewright_renderer::statistics::Summary;
use treewright_renderer::tuning::objective::Objective;

/// The results of an ablation.
#[derive(Clone, Debug, Serialize)]
pub struct Ablation {
    /// Name of the scene.
    pub scene: String,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Render threads.
    pub threads: usize,
    /// The objective, which decides the cost of a frame.
    pub objective: Objective,
    /// Rounds that were run.
    pub rounds: usize,
    /// Frames of native Embree as everybody uses it.
    pub baseline_ms: Summary,
    /// Frames of the winner.
    pub tuned_ms: Summary,
    /// Of the winner over that.
    pub speedup: Summary,
    /// The winner.
    pub tuned: Configuration,
    /// One for each value in which the two differ.
    pub rows: Vec<Row>,
}

/// A value of the winner and its gains.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The parameter.
    pub name: String,
    /// The winner's value.
    pub value: String,
    /// The value that it is compared with.
    pub plain: String,
    /// Speed of the winner over the winner without it.
    pub kept: Summary,
    /// Speed of native Embree with it, and with the values that it requires, over native Embree.
    pub alone: Summary,
    /// Why there is nothing, if one of the two cannot be built.
    pub failure: Option<String>,
}

/// The page. Numbers arrive as text.
#[derive(Template)]
#[template(path = "ablation.html")]
struct Page<'a> {
    scene: &'a str,
    size: String,
    threads: usize,
    rounds: usize,
    baseline_ms: String,
    tuned_ms: String,
    speedup: String,
    rows: Vec<PageRow<'a>>,
}

struct PageRow<'a> {
    row: &'a Row,
    kept: Bar,
    alone: Bar,
}

/// A gain as a bar that begins at the line of "no difference".
struct Bar {
    text: String,
    spread: String,
    /// Begin and length in percent of the column.
    left: f64,
    width: f64,
    loses: bool,
}

/// Puts the page together.
pub fn html(ablation: &Ablation) -> Result<String, askama::Error> {
    let all = ablation.rows.iter().flat_map(|row| [row.kept.median, row.alone.median]);
    let reach = all.filter(|ratio| *ratio > 0.0).map(|ratio| ratio.ln().abs()).fold(0.05, f64::max);
    let page = Page {
        scene: &ablation.scene,
        size: format!("{} × {}", ablation.size[0], ablation.size[1]),
        threads: ablation.threads,
        rounds: ablation.rounds,
        baseline_ms: format!("{:.1}", ablation.baseline_ms.median),
        tuned_ms: format!("{:.1}", ablation.tuned_ms.median),
        speedup: format!("{:.2}", ablation.speedup.median),
        rows: ablation
            .rows
            .iter()
            .map(|row| PageRow { row, kept: bar(&row.kept, reach), alone: bar(&row.alone, reach) })
            .collect(),
    };
    page.render()
}

/// Logarithmic, so that twice and half as fast are equally long.
fn bar(ratio: &Summary, reach: f64) -> Bar {
    let share = if ratio.median > 0.0 { (ratio.median.ln() / reach).clamp(-1.0, 1.0) * 50.0 } else { 0.0 };
    Bar {
        text: format!("{:.2} ×", ratio.median),
        spread: format!("{:.2} – {:.2}", ratio.lower_quartile, ratio.upper_quartile),
        left: if share < 0.0 { 50.0 + share } else { 50.0 },
        width: share.abs(),
        loses: share < 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_go_to_the_right_and_losses_to_the_left() {
        let ratio = |median: f64| Summary { median, ..Summary::default() };
        let reach = 2.0_f64.ln();
        let (gain, loss) = (bar(&ratio(2.0), reach), bar(&ratio(0.5), reach));
        assert_eq!((gain.left, gain.width, gain.loses), (50.0, 50.0, false));
        assert_eq!((loss.left, loss.width, loss.loses), (0.0, 50.0, true));
        assert_eq!(bar(&ratio(0.0), reach).width, 0.0, "nothing was measured");
    }

    #[test]
    fn the_page_has_a_line_for_each_value() {
        let summary =
            |median: f64| Summary { lower_quartile: median, median, upper_quartile: median, count: 3 };
        let row = |name: &str, kept: f64| Row {
            name: name.into(),
            value: "<16>".into(),
            plain: "8".into(),
            kept: summary(kept),
            alone: summary(1.0),
            failure: None,
        };
        let ablation = Ablation {
            scene: "hall".into(),
            size: [320, 240],
            threads: 2,
            objective: Objective::Render,
            rounds: 3,
            baseline_ms: summary(90.0),
            tuned_ms: summary(60.0),
            speedup: summary(1.5),
            tuned: Configuration::new(),
            rows: vec![row("staged", 1.2), row("tile", 0.97)],
        };
        let html = html(&ablation).expect("the page is made");
        assert_eq!(html.matches("class=\"gain").count(), 4);
        assert!(html.contains("1.20 ×") && html.contains("0.97 ×") && html.contains("1.50"));
        assert!(!html.contains("<16>"), "values are escaped");
    }
}
