//! Figures as SVG: axes, marks, legends and one palette. Lines and text take the colour of the page around
//! them; there are no scripts, classes or inline styles that a page would have to allow or define.

mod axis;
mod colour;
mod figure;
mod front;

pub use axis::{Axis, number};
pub use colour::Colour;
pub use figure::{Dot, Figure, Stroke};
pub use front::Marked;

/// Text as it stands in SVG and HTML.
pub fn escaped(text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    text.replace('"', "&quot;").replace('\'', "&#39;")
}
