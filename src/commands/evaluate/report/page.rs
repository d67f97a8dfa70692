//! The page around the plots: head, main figures, sections, tables.

use maud::{DOCTYPE, Markup, PreEscaped, html};

/// Style sheets: the dashboard's colours, and this page's own styles.
pub const STYLES: [&str; 2] = [include_str!("../../../../static/styles/tokens.css"), include_str!("report.css")];

/// A complete page without scripts and without external resources. Its content security policy forbids both.
pub fn page(title: &str, about: &str, body: &[Markup]) -> String {
    let policy = "default-src 'none'; style-src 'unsafe-inline'";
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(policy);
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) ": " (about) }
                style { (PreEscaped(STYLES.concat())) }
            }
            body {
                main {
                    header {
                        h1 { (title) }
                        p.about { (about) }
                    }
                    @for part in body { (part) }
                }
            }
        }
    };
    page.into_string()
}

/// The main figures at the top of the page: name, value with unit, meaning.
pub fn lead(figures: &[(&str, String, &str)]) -> Markup {
    html! {
        section.lead {
            @for (name, value, meaning) in figures {
                div.tile {
                    p.name { (name) }
                    p.value { (value) }
                    p.meaning { (meaning) }
                }
            }
        }
    }
}

/// A section of the page.
pub fn section(title: &str, body: Markup) -> Markup {
    html! {
        section {
            h2 { (title) }
            (body)
        }
    }
}

/// A section with pictures and their caption.
pub fn pictures(title: &str, pictures: &[Markup], caption: &str) -> Markup {
    section(
        title,
        html! {
            @for picture in pictures { (picture) }
            p.caption { (caption) }
        },
    )
}

/// A table. The first row is the head, the first column holds the row names.
pub fn table(rows: &[Vec<String>]) -> Markup {
    html! {
        div.wide {
            table {
                thead {
                    @for row in rows.iter().take(1) {
                        tr { @for cell in row { th scope="col" { (cell) } } }
                    }
                }
                tbody {
                    @for row in rows.iter().skip(1) {
                        tr {
                            @for cell in row.iter().take(1) { th scope="row" { (cell) } }
                            @for cell in row.iter().skip(1) { td { (cell) } }
                        }
                    }
                }
            }
        }
    }
}
