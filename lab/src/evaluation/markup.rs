//! Cards and tables of the page.

use treewright_figures::escaped;

pub(super) fn card(svg: &str) -> String {
    format!("<div class=\"card\">{svg}</div>")
}

/// A table on a card. The first cell of a row is its name; the others show their heads on narrow screens.
pub(super) fn table(heads: &[&str], rows: &[Vec<String>]) -> String {
    let titles: String = heads.iter().map(|head| format!("<th>{head}</th>")).collect();
    let cell = |(place, (head, cell)): (usize, (&&str, &String))| {
        let name = if place == 0 { String::new() } else { format!(" data-l=\"{head}\"") };
        format!("<td{name}>{}</td>", escaped(cell))
    };
    let row = |cells: &Vec<String>| {
        let cells: String = heads.iter().zip(cells).enumerate().map(cell).collect();
        format!("<tr>{cells}</tr>")
    };
    let rows: String = rows.iter().map(row).collect();
    card(&format!("<table><tr>{titles}</tr>{rows}</table>"))
}
