//! Builds the parts of pages, each of which is one file that opens from disk without scripts or network.

use super::plot::{self, Plot};
use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = include_str!("style.css");

/// Returns a self-contained page around `body`, under a heading, with a note about the folder of plots.
pub fn document(title: &str, lead: &str, facts: &[(&str, String)], body: Markup) -> String {
    let note = html! { p.note { "The folder " code { "figures" } " has each plot of this page as SVG and as PDF." } };
    bare(title, lead, facts, html! { (body) (note) })
}

/// Returns a self-contained page whose plots are in no folder.
pub fn bare(title: &str, lead: &str, facts: &[(&str, String)], body: Markup) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width,initial-scale=1";
                title { (title) }
                style { (PreEscaped(plot::STYLE)) (PreEscaped(STYLE)) }
            }
            body {
                main {
                    header {
                        h1 { (title) }
                        p.lead { (lead) }
                        dl.facts { @for (name, value) in facts { div { dt { (name) } dd { (value) } } } }
                    }
                    (body)
                }
            }
        }
    }
    .into_string()
}

/// Returns a part of a page under a heading that links can reach.
pub fn section(id: &str, title: &str, body: Markup) -> Markup {
    html! { section aria-labelledby=(id) { h2 id=(id) { (title) } (body) } }
}

/// Returns a plot with its name and its description.
pub(crate) fn figure(plot: &Plot, name: &str, about: &str) -> Markup {
    html! { figure { figcaption { b { (name) } " " span { (about) } } (plot.svg()) } }
}

/// Returns a table whose first column names its rows. Rows are `tr` elements.
pub fn table(caption: &str, columns: &[&str], rows: impl IntoIterator<Item = Markup>) -> Markup {
    html! {
        div.scroll tabindex="0" role="region" aria-label=(caption) {
            table {
                caption { (caption) }
                thead { tr { @for (i, name) in columns.iter().enumerate() { th scope="col" .left[i == 0] { (name) } } } }
                tbody { @for row in rows { (row) } }
            }
        }
    }
}

/// Returns a row of a table as its name and its cells.
pub fn row(name: &str, cells: impl IntoIterator<Item = String>) -> Markup {
    html! { tr { th scope="row" .words[name.len() > 24] { (name) } @for cell in cells { td .words[cell.len() > 24] { (cell) } } } }
}

/// Returns a list of statements with their results. Each has a class (`holds`, `partly`, `fails` or `open`), a title, a
/// tag, numbers and a note.
pub(crate) fn statements<'a>(all: impl IntoIterator<Item = (&'a str, String, &'a str, Vec<String>, String)>) -> Markup {
    html! {
        ul.claims {
            @for (class, title, tag, numbers, note) in all {
                li class=(class) {
                    div.head { strong { (title) } span.tag { (tag) } }
                    ul { @for line in numbers { li { (line) } } }
                    @if !note.is_empty() { p { (note) } }
                }
            }
        }
    }
}
