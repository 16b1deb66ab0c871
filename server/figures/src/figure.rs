//! A figure: marks between two axes, and the legend that their names make.

use std::fmt::{Arguments, Write as _};

use crate::{Axis, Colour, escaped};

/// Room for a legend's swatch, and for one of its letters on a small screen, where text is larger.
const SWATCH: f64 = 26.0;
const LETTER: f64 = 8.6;
/// The length of the longest label of a mark, in letters, and the width of one of them.
const LABEL_MAX: usize = 28;
const LABEL_LETTER: f64 = 7.5;
/// Down from one row of a legend to the next.
const LEGEND_ROW: f64 = 20.0;
/// A page of its own has no colours to take.
const STYLE: &str = "svg{color:#1d1f24;background:#fff}\
@media(prefers-color-scheme:dark){svg{color:#e9e7e2;background:#16181c}}";

/// The look of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stroke {
    /// A measured curve.
    Solid,
    /// A level to compare with.
    Dashed,
    /// Another level.
    Dotted,
    /// One of many.
    Thin,
}

impl Stroke {
    fn attributes(self) -> &'static str {
        match self {
            Self::Solid => r#"fill="none" stroke-width="2""#,
            Self::Dashed => r#"fill="none" stroke-width="2" stroke-dasharray="7 4""#,
            Self::Dotted => r#"fill="none" stroke-width="2" stroke-dasharray="2 4""#,
            Self::Thin => r#"fill="none" stroke-width="1.2" stroke-opacity=".6""#,
        }
    }
}

/// The look of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Dot {
    /// One of many.
    Small,
    /// One of few.
    Large,
    /// One that is not to be trusted.
    Hollow,
    /// Around another point.
    Ring,
    /// Small, with an opacity of 0 to 1.
    Shade(f64),
}

impl Dot {
    fn at(self, [x, y]: [f64; 2], colour: Colour) -> String {
        let (radius, look) = match self {
            Self::Small => (3, format!(r#"fill="{colour}""#)),
            Self::Large => (6, format!(r#"fill="{colour}""#)),
            Self::Hollow => (3, format!(r#"fill="none" stroke="{colour}""#)),
            Self::Ring => (8, format!(r#"fill="{colour}" fill-opacity=".25" stroke="{colour}""#)),
            Self::Shade(opacity) => (4, format!(r#"fill="{colour}" fill-opacity="{opacity:.2}""#)),
        };
        format!(r#"<circle cx="{x:.1}" cy="{y:.1}" r="{radius}" {look}>"#)
    }
}

/// A figure that is being drawn. What lies beyond an axis is drawn at its edge, points as triangles.
#[derive(Debug)]
pub struct Figure {
    title: String,
    size: [f64; 2],
    /// Left, top, right and bottom of the space between the axes.
    area: [f64; 4],
    x: Axis,
    y: Axis,
    body: String,
    /// Swatches and names.
    keys: Vec<(String, String)>,
}

impl Figure {
    /// Two axes in a figure of a width and a height in units of its own, about a pixel each; a legend comes
    /// below. The title is what a reader hears who does not see it.
    pub fn new(title: &str, size: [f64; 2], x: Axis, y: Axis) -> Self {
        let (across, up) = (x.marks(), y.marks());
        let [width, height] = size;
        // Names of rows have at most half of the width.
        let most = ((0.5 * width - 14.0) / LABEL_LETTER).clamp(1.0, LABEL_MAX as f64) as usize;
        let longest = up.iter().map(|(_, label)| label.chars().count()).max().unwrap_or(0);
        let left = (14.0 + LABEL_LETTER * longest.min(most) as f64).max(24.0);
        let [over, under] = [y.heading(), x.heading()];
        let (top, right) = (if over.is_empty() { 8.0 } else { 26.0 }, width - 20.0);
        let bottom = height - if under.is_empty() { 24.0 } else { 42.0 };
        let area = [left, top, right, bottom];
        let mut figure =
            Self { title: title.to_owned(), size, area, x, y, body: String::new(), keys: Vec::new() };
        for (tick, label) in across {
            let at = figure.at_x(tick);
            figure.grid(format_args!("M{at:.1} {top}V{bottom}"));
            // Names of ends stay inside; numbers are short.
            let anchor = match figure.x.share(tick) {
                0.0 => "start",
                1.0 => "end",
                _ => "middle",
            };
            figure.label([at, bottom + 16.0], anchor, &label, LABEL_MAX);
        }
        for (tick, label) in up {
            let at = figure.at_y(tick);
            if !figure.y.is_rows() {
                figure.grid(format_args!("M{left:.1} {at:.1}H{right}"));
            }
            figure.label([left - 6.0, at + 4.0], "end", &label, most);
        }
        figure.text([(left + right) / 2.0, height - 8.0], "middle", &under);
        figure.text([8.0, 14.0], "start", &over);
        if figure.y.begins_above_zero() {
            figure.text([right, 14.0], "end", "not from 0");
        }
        figure
    }

    /// A row for each name, 24 units high, over an axis.
    pub fn of_rows<S: AsRef<str>>(title: &str, width: f64, x: Axis, names: &[S]) -> Self {
        Self::new(title, [width, 24.0 * names.len() as f64 + 50.0], x, Axis::rows(names))
    }

    fn put(&mut self, words: Arguments<'_>) {
        // Writing to a string cannot fail.
        let _ = self.body.write_fmt(words);
    }

    fn grid(&mut self, path: Arguments<'_>) {
        self.put(format_args!(r#"<path d="{path}" stroke="currentColor" stroke-opacity=".2"/>"#));
    }

    fn at_x(&self, value: f64) -> f64 {
        let [left, _, right, _] = self.area;
        left + self.x.share(value) * (right - left)
    }

    fn at_y(&self, value: f64) -> f64 {
        let [_, top, _, bottom] = self.area;
        bottom - self.y.share(value) * (bottom - top)
    }

    /// Where a point lies, from the left and from the top.
    pub fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.at_x(x), self.at_y(y)]
    }

    /// Words at a place from the left and the top; the anchor is `start`, `middle` or `end`.
    pub fn text(&mut self, [x, y]: [f64; 2], anchor: &str, words: &str) {
        if !words.is_empty() {
            let words = escaped(words);
            self.put(format_args!(r#"<text x="{x:.1}" y="{y:.1}" text-anchor="{anchor}">{words}</text>"#));
        }
    }

    /// Words at a place, cut to `most` letters; a pointer shows all of them.
    fn label(&mut self, [x, y]: [f64; 2], anchor: &str, words: &str, most: usize) {
        if words.chars().count() <= most {
            return self.text([x, y], anchor, words);
        }
        let short: String = words.chars().take(most - 1).collect();
        let (short, hint) = (escaped(&short), hint(words));
        self.put(format_args!(r#"<text x="{x:.1}" y="{y:.1}" text-anchor="{anchor}">{short}…{hint}</text>"#));
    }

    fn key(&mut self, name: &str, swatch: impl FnOnce() -> String) {
        if !name.is_empty() && self.keys.iter().all(|(_, known)| known != name) {
            self.keys.push((swatch(), name.to_owned()));
        }
    }

    /// The name of points of this look in the legend.
    pub fn dot_key(&mut self, dot: Dot, colour: Colour, name: &str) {
        self.key(name, || dot.at([11.0, 0.0], colour) + "</circle>");
    }

    /// The name of a colour of areas in the legend.
    pub fn area_key(&mut self, colour: Colour, name: &str) {
        self.key(name, || format!(r#"<rect y="-6" width="22" height="12" fill="{colour}"/>"#));
    }

    /// The scale of colours in the legend, with what its ends are.
    pub fn scale_key(&mut self, best: &str, worst: &str) {
        let cell = |place: f64| {
            let (x, colour) = (18.0 * place, Colour::Scale(place));
            format!(r#"<rect x="{x:.1}" y="-6" width="4" height="12" fill="{colour}"/>"#)
        };
        let cells = [0.0, 0.25, 0.5, 0.75, 1.0].map(cell).concat();
        self.key(&format!("from blue: {best}, to orange: {worst}"), || cells);
    }

    /// A line through points; its name stands in the legend and at a pointer.
    pub fn line(&mut self, points: &[[f64; 2]], stroke: Stroke, colour: Colour, name: &str) {
        let mut path = String::new();
        for point in points {
            let ([x, y], step) = (self.place(*point), if path.is_empty() { 'M' } else { 'L' });
            let _ = write!(path, "{step}{x:.1} {y:.1}");
        }
        self.path(&path, stroke, colour, name);
        self.mark_beyond(points, colour);
    }

    /// Marks those points of a line that lie beyond the vertical axis.
    fn mark_beyond(&mut self, points: &[[f64; 2]], colour: Colour) {
        for point in points {
            if !self.y.holds(point[1]) {
                self.dot(*point, Dot::Small, colour, "");
            }
        }
    }

    /// A line that keeps each value until the next.
    pub fn steps(&mut self, points: &[[f64; 2]], colour: Colour, name: &str) {
        let mut path = String::new();
        for point in points {
            let [x, y] = self.place(*point);
            let (across, up) = if path.is_empty() { ('M', ' ') } else { ('H', 'V') };
            let _ = write!(path, "{across}{x:.1}{up}{y:.1}");
        }
        self.path(&path, Stroke::Solid, colour, name);
        self.mark_beyond(points, colour);
    }

    fn path(&mut self, path: &str, stroke: Stroke, colour: Colour, name: &str) {
        if path.is_empty() {
            return;
        }
        let look = stroke.attributes();
        self.put(format_args!(r#"<path d="{path}" {look} stroke="{colour}">{}</path>"#, hint(name)));
        self.key(name, || format!(r#"<path d="M0 0h22" {look} stroke="{colour}"/>"#));
    }

    /// A line across at one value.
    pub fn level(&mut self, y: f64, stroke: Stroke, colour: Colour, name: &str) {
        let [low, high] = self.x.range();
        self.line(&[[low, y], [high, y]], stroke, colour, name);
    }

    /// The area between two curves: x, lower and upper end.
    pub fn band(&mut self, points: &[[f64; 3]], colour: Colour) {
        let there = points.iter().map(|[x, low, _]| [*x, *low]);
        let back = points.iter().rev().map(|[x, _, high]| [*x, *high]);
        let corners = there.chain(back).map(|point| {
            let [x, y] = self.place(point);
            format!("{x:.1},{y:.1} ")
        });
        let corners: String = corners.collect();
        self.put(format_args!(r#"<polygon points="{corners}" fill="{colour}" fill-opacity=".2"/>"#));
    }

    /// A thin bar from one point to another, such as an interval.
    pub fn interval(&mut self, from: [f64; 2], to: [f64; 2], colour: Colour) {
        let ([x, y], [to_x, to_y]) = (self.place(from), self.place(to));
        self.put(format_args!(r#"<path d="M{x:.1} {y:.1}L{to_x:.1} {to_y:.1}" stroke="{colour}"/>"#));
    }

    /// A point with the text that a pointer shows.
    pub fn dot(&mut self, at: [f64; 2], dot: Dot, colour: Colour, title: &str) {
        let ([x, y], hint) = (self.place(at), hint(title));
        if self.x.holds(at[0]) && self.y.holds(at[1]) {
            self.put(format_args!("{}{hint}</circle>", dot.at([x, y], colour)));
            return;
        }
        let (tip, foot) = if self.y.share(at[1]) < 0.5 { (y, y - 8.0) } else { (y, y + 8.0) };
        let (left, right) = (x - 4.0, x + 4.0);
        self.put(format_args!(
            r#"<path d="M{x:.1} {tip:.1}L{left:.1} {foot:.1}H{right:.1}z" fill="{colour}">{hint}</path>"#
        ));
        self.key("beyond the axis", || r#"<path d="M11 -4l4 8h-8z" fill="currentColor"/>"#.to_owned());
    }

    /// A cross above the horizontal axis: nothing was measured there.
    pub fn cross(&mut self, x: f64, colour: Colour, name: &str) {
        let (x, y) = (self.at_x(x) - 3.0, self.area[3] - 10.0);
        let look = format!(r#"fill="none" stroke="{colour}" stroke-width="2""#);
        self.put(format_args!(r#"<path d="M{x:.1} {y:.1}l6 6m0 -6l-6 6" {look}>{}</path>"#, hint(name)));
        self.key(name, || format!(r#"<path d="M8 -3l6 6m0 -6l-6 6" {look}/>"#));
    }

    /// A rectangle between two ends of each axis, at least one unit wide, with the text that a pointer shows.
    pub fn cell(&mut self, x: [f64; 2], y: [f64; 2], opacity: f64, colour: Colour, title: &str) {
        let ([left, right], [one, other]) = (x.map(|x| self.at_x(x)), y.map(|y| self.at_y(y)));
        let (left, width) = (left.min(right), (right - left).abs().max(1.0));
        let (top, height) = (one.min(other), (one - other).abs().max(1.0));
        self.put(format_args!(
            r#"<rect x="{left:.1}" y="{top:.1}" width="{width:.1}" height="{height:.1}" fill="{colour}" fill-opacity="{opacity}">{}</rect>"#,
            hint(title)
        ));
    }

    /// A bar in a row from one value to another.
    pub fn bar(&mut self, row: usize, ends: [f64; 2], opacity: f64, colour: Colour, title: &str) {
        self.cell(ends, [0.15, 0.85].map(|share| row as f64 + share), opacity, colour, title);
    }

    /// Makes all that is drawn inside a link, with a label for screen readers.
    pub fn link(&mut self, target: &str, label: &str, inside: impl FnOnce(&mut Self)) {
        self.put(format_args!(r#"<a href="{}" aria-label="{}">"#, escaped(target), escaped(label)));
        inside(self);
        self.body += "</a>";
    }

    /// The title, the height with the legend, and everything inside.
    fn done(mut self) -> (String, [f64; 2], String) {
        let [width, height] = self.size;
        let (mut x, mut y) = (8.0, height + LEGEND_ROW / 2.0);
        for (swatch, name) in std::mem::take(&mut self.keys) {
            let needed = SWATCH + LETTER * (name.chars().count() + 2) as f64;
            if x > 8.0 && x + needed > width {
                (x, y) = (8.0, y + LEGEND_ROW);
            }
            self.put(format_args!(r#"<g transform="translate({x:.1} {y})">{swatch}</g>"#));
            self.text([x + SWATCH, y + 4.0], "start", &name);
            x += needed;
        }
        let height = if x > 8.0 { y + LEGEND_ROW / 2.0 } else { height };
        (self.title, [width, height], self.body)
    }

    /// The finished figure for the inside of a page.
    pub fn finish(self) -> String {
        let (title, size, body) = self.done();
        element("", &title, size, &body)
    }

    /// Figures one below the other, under a heading, as a file of its own.
    pub fn file(title: &str, figures: impl IntoIterator<Item = Self>) -> String {
        let heading = format!(r#"<text x="8" y="18" font-weight="bold">{}</text>"#, escaped(title));
        let mut all = format!("<style>{STYLE}</style>{heading}");
        let (mut below, mut across) = (24.0, 0.0_f64);
        for (_, [width, height], body) in figures.into_iter().map(Self::done) {
            let _ = write!(all, r#"<g transform="translate(0 {below})">{body}</g>"#);
            (below, across) = (below + height, across.max(width));
        }
        let space = r#"xmlns="http://www.w3.org/2000/svg" font-family="system-ui,sans-serif" "#;
        element(space, title, [across, below], &all) + "\n"
    }
}

fn hint(title: &str) -> String {
    if title.is_empty() { String::new() } else { format!("<title>{}</title>", escaped(title)) }
}

fn element(space: &str, title: &str, [width, height]: [f64; 2], body: &str) -> String {
    let title = escaped(title);
    format!(
        "<svg {space}viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{title}\" font-size=\"12\" \
         fill=\"currentColor\"><title>{title}</title>{body}</svg>"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure() -> Figure {
        let axis = |title: &str| Axis::between(title, 0.0, 10.0);
        Figure::new("a < b", [220.0, 150.0], axis("x & y"), axis("'ms'"))
    }

    #[test]
    fn what_people_write_is_escaped() {
        let mut all = figure();
        all.line(&[[0.0, 0.0], [10.0, 10.0]], Stroke::Solid, Colour::Blue, "<b>");
        all.dot([1.0, 1.0], Dot::Small, Colour::Blue, "<b>");
        all.link("/?a=\"", "<b>", |inside| inside.cell([0.0, 1.0], [0.0, 1.0], 1.0, Colour::Grey, "<b>"));
        all.scale_key("<b>", "<b>");
        let rows = Figure::of_rows("<b>", 300.0, Axis::ends("<b>", "<b>", "<b>"), &["<b>"]);
        for svg in [all.finish(), Figure::file("<b>", [rows])] {
            assert!(
                !svg.contains("<b>") && !svg.contains("a=\"\"") && svg.trim().ends_with("</svg>"),
                "{svg}"
            );
            assert!(svg.contains("&lt;b&gt;") && !svg.contains("NaN"));
        }
    }

    #[test]
    fn points_lie_on_their_axes_and_those_beyond_are_marked() {
        let mut figure = figure();
        let ([left, bottom], [right, top]) = (figure.place([0.0, 0.0]), figure.place([10.0, 10.0]));
        let [x, y] = figure.place([5.0, 2.5]);
        assert!(
            (x - (left + right) / 2.0).abs() < 1e-9 && (y - (bottom + 0.25 * (top - bottom))).abs() < 1e-9
        );
        figure.dot([5.0, 5.0], Dot::Large, Colour::Green, "inside");
        figure.dot([5.0, 50.0], Dot::Large, Colour::Green, "outside");
        figure.cross(5.0, Colour::Green, "failed");
        let svg = figure.finish();
        assert_eq!(
            (svg.matches("<circle").count(), svg.matches(">beyond the axis<").count()),
            (1, 1),
            "{svg}"
        );
        assert_eq!(svg.matches("<title>").count(), 4, "{svg}");
    }

    #[test]
    fn steps_go_across_before_they_go_up() {
        let mut figure = figure();
        figure.steps(&[[0.0, 10.0], [5.0, 5.0], [10.0, 0.0]], Colour::Blue, "");
        let svg = figure.finish();
        let path = svg.split("<path d=\"").find(|path| path.contains("fill=\"none\"")).expect("the line");
        let commands: String =
            path.split('"').next().expect("it ends").matches(char::is_alphabetic).collect();
        assert_eq!(commands, "MHVHV");
        assert!(!svg.contains("beyond the axis"), "{svg}");
        let mut figure = self::figure();
        figure.steps(&[[0.0, 30.0], [5.0, 5.0]], Colour::Blue, "");
        assert!(figure.finish().contains("beyond the axis"), "it begins above");
    }

    #[test]
    fn a_legend_names_each_colour_once_and_makes_room() {
        let height = |svg: &str| -> f64 {
            let view =
                svg.split("viewBox=\"").nth(1).and_then(|rest| rest.split('"').next()).expect("a view");
            view.rsplit(' ').next().and_then(|height| height.parse().ok()).expect("a height")
        };
        assert_eq!(height(&figure().finish()), 150.0);
        let mut named = figure();
        for (index, name) in ["the first", "the second", "the first", ""].into_iter().enumerate() {
            named.level(index as f64, Stroke::Dashed, Colour::of(index), name);
        }
        let svg = named.finish();
        assert_eq!((svg.matches(">the first</text>").count(), height(&svg)), (1, 190.0), "{svg}");
    }

    #[test]
    fn a_legend_shows_dots_as_they_are_drawn() {
        let mut named = figure();
        for (dot, radius) in [(Dot::Small, 3), (Dot::Large, 6), (Dot::Hollow, 3), (Dot::Ring, 8)] {
            named.dot_key(dot, Colour::Blue, &format!("{dot:?}"));
            let (swatch, _) = named.keys.last().expect("a key");
            assert!(swatch.contains(&format!("r=\"{radius}\"")) && swatch.ends_with("</circle>"), "{swatch}");
        }
    }

    #[test]
    fn long_names_of_rows_are_cut_where_it_shows() {
        let long = format!("{}&{}", "a".repeat(30), "b".repeat(30));
        let cut = |width: f64| {
            let share = Axis::between("share", 0.0, 1.0);
            let svg = Figure::of_rows("rows", width, share, &[long.as_str(), "b"]).finish();
            assert!(svg.contains(&format!("…<title>{}</title></text>", escaped(&long))), "{svg}");
            let (before, _) = svg.split_once('…').expect("it is cut");
            before.rsplit('>').next().map_or(0, str::len)
        };
        // As many letters as half of the width holds, but no more than 28.
        assert_eq!((cut(340.0), cut(900.0)), (19, 27));
    }

    #[test]
    fn bars_lie_in_their_rows() {
        let mut figure = Figure::of_rows("rows", 400.0, Axis::between("share", 0.0, 1.0), &["a", "b"]);
        figure.bar(1, [0.0, 0.0], 1.0, Colour::Blue, "");
        let svg = figure.finish();
        // 24 down in each row, from 8 below the top; as wide as can be seen.
        assert!(svg.contains("y=\"35.6\" width=\"1.0\" height=\"16.8\""), "{svg}");
    }
}
