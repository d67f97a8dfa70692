//! The page around the plots: head, lead figures, sections, tables.

use super::node::{Markup, element, style, text, void_element};

/// Style sheets: the dashboard's colours, and this page's own styles.
const STYLES: [&str; 2] = [include_str!("../../../../static/styles/tokens.css"), include_str!("report.css")];

/// A complete page without scripts and without external resources. Its content security policy forbids both.
pub fn page(title: &str, about: &str, body: impl IntoIterator<Item = Markup>) -> String {
    let policy = "default-src 'none'; style-src 'unsafe-inline'";
    let head = [
        void_element("meta", &[("charset", "utf-8")]),
        void_element("meta", &[("http-equiv", "Content-Security-Policy"), ("content", policy)]),
        void_element("meta", &[("name", "viewport"), ("content", "width=device-width, initial-scale=1")]),
        void_element("meta", &[("name", "color-scheme"), ("content", "light dark")]),
        element("title", &[], [text(format!("{title}: {about}"))]),
        style(&STYLES),
    ];
    let top =
        element("header", &[], [element("h1", &[], [text(title)]), element("p", &[("class", "about")], [text(about)])]);
    let main = element("main", &[], [top].into_iter().chain(body));
    let page = element("html", &[("lang", "en")], [element("head", &[], head), element("body", &[], [main])]);
    format!("<!doctype html>\n{}\n", page.as_str())
}

/// The main figures at the top of the page: name, value with unit, meaning.
pub fn lead(figures: &[(&str, String, &str)]) -> Markup {
    let tile = |(name, value, meaning): &(&str, String, &str)| {
        let lines = [("name", *name), ("value", value.as_str()), ("meaning", *meaning)];
        element(
            "div",
            &[("class", "tile")],
            lines.map(|(class, words)| element("p", &[("class", class)], [text(words)])),
        )
    };
    element("section", &[("class", "lead")], figures.iter().map(tile))
}

/// A section of the page.
pub fn section(title: &str, body: impl IntoIterator<Item = Markup>) -> Markup {
    element("section", &[], [element("h2", &[], [text(title)])].into_iter().chain(body))
}

/// A paragraph.
pub fn paragraph(words: &str) -> Markup {
    element("p", &[], [text(words)])
}

/// The caption of a section's pictures.
pub fn caption(words: &str) -> Markup {
    element("p", &[("class", "caption")], [text(words)])
}

/// A table. The first row is the head, the first column holds the row names.
pub fn table(rows: &[Vec<String>]) -> Markup {
    let cell = |head: bool, first: bool, words: &String| match (head, first) {
        (true, _) => element("th", &[("scope", "col")], [text(words)]),
        (false, true) => element("th", &[("scope", "row")], [text(words)]),
        (false, false) => element("td", &[], [text(words)]),
    };
    let row = |(at, cells): (usize, &Vec<String>)| {
        element("tr", &[], cells.iter().enumerate().map(move |(column, words)| cell(at == 0, column == 0, words)))
    };
    let mut rows = rows.iter().enumerate().map(row);
    let head = element("thead", &[], rows.next());
    element("div", &[("class", "wide")], [element("table", &[], [head, element("tbody", &[], rows)])])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_asks_for_nothing_from_elsewhere_and_holds_no_script() {
        let page = page("a", "<img src=//evil.example/x onerror=alert(1)>", [paragraph("<script>")]);
        assert!(page.starts_with("<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"), "{page:.200}");
        for asks in ["<script", "<img", "<link", "src=\"", "url(", "@import", "http://", "https://"] {
            assert!(!page.contains(asks), "{asks}");
        }
    }
}
