//! What pages are made of: one file that opens from disk, without scripts and without a network.

use super::plot::{self, Plot};
use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = include_str!("style.css");

/// A self-contained page around `body`, under a heading.
pub fn document(title: &str, lead: &str, facts: &[(&str, String)], body: Markup) -> String {
    let note = html! { p.note { "Every plot here is in the folder " code { "figures" } " too, by itself, as SVG and as PDF." } };
    bare(title, lead, facts, html! { (body) (note) })
}

/// Such a page whose plots are in no folder.
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

/// A part of a page under a heading that links can reach.
pub fn section(id: &str, title: &str, body: Markup) -> Markup {
    html! { section aria-labelledby=(id) { h2 id=(id) { (title) } (body) } }
}

/// A plot with what it is called and what it shows.
pub(crate) fn figure(plot: &Plot, name: &str, about: &str) -> Markup {
    html! { figure { figcaption { b { (name) } " " span { (about) } } (plot.svg()) } }
}

/// A table whose first column names its rows; rows are `tr` elements.
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

/// A row of a table: its name, then its cells.
pub fn row(name: &str, cells: impl IntoIterator<Item = String>) -> Markup {
    html! { tr { th scope="row" .words[name.len() > 24] { (name) } @for cell in cells { td .words[cell.len() > 24] { (cell) } } } }
}

/// Statements with what came of each: class (`holds`, `partly`, `fails` or `open`), title, tag, numbers, and a note.
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
