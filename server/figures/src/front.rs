//! Pareto fronts: configurations by two of their metrics.

use crate::{Axis, Colour, Dot, Figure};

/// A configuration in a figure of a front: its two metrics, and the text that a pointer shows.
pub type Marked = ([f64; 2], String);

impl Figure {
    /// Configurations by two metrics, which are the titles of the axes: the dominated ones in grey, those on
    /// the front, and the default marked. `corners` are those of the staircase that joins the front, the best
    /// of the first metric first.
    pub fn front(
        size: [f64; 2],
        [x, y]: [&str; 2],
        [dominated, front, default]: [&[Marked]; 3],
        corners: &[[f64; 2]],
    ) -> Self {
        let axis = |title: &str, metric: usize| {
            Axis::fitting(title, dominated.iter().chain(front).map(|(at, _)| at[metric]))
        };
        let mut figure = Self::new(&format!("{y} over {x}"), size, axis(x, 0), axis(y, 1));
        figure.steps(corners, Colour::Blue, "");
        for (marked, dot, colour, name) in [
            (dominated, Dot::Small, Colour::Grey, "others"),
            (front, Dot::Large, Colour::Blue, "front"),
            (default, Dot::Ring, Colour::Vermilion, "default"),
        ] {
            figure.dot_key(dot, colour, name);
            for (at, words) in marked {
                figure.dot(*at, dot, colour, words);
            }
        }
        figure
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_front_is_a_staircase_of_dots_with_titles() {
        let marked = |x: f64, y: f64, words: &str| ([x, y], words.to_owned());
        let others = [marked(4.0, 4.0, "<worse>")];
        let front = [marked(1.0, 3.0, "fast"), marked(3.0, 1.0, "small")];
        let svg = Figure::front(
            [400.0, 300.0],
            ["time_ms (lower is better)", "memory_mb (lower is better)"],
            [&others, &front, &front[1..]],
            &[[1.0, 3.0], [3.0, 1.0]],
        )
        .finish();
        // Four configurations, and three names of the legend.
        assert_eq!(svg.matches("<circle").count(), 7, "{svg}");
        assert!(svg.contains("<title>fast</title>") && svg.contains("<title>&lt;worse&gt;</title>"), "{svg}");
        assert!(svg.contains(">time_ms (lower is better)<") && svg.contains(">memory_mb (lower is better)<"));
        let stairs =
            svg.split("<path d=\"").find(|path| path.contains("stroke-width=\"2\"")).expect("stairs");
        let path = stairs.split('"').next().expect("a path");
        let (across, up) = (path.find('H').expect("across"), path.find('V').expect("up"));
        assert!(path.starts_with('M') && across < up, "across at the value before: {path}");
    }
}
