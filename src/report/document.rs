//! A report as a list of blocks. It is written as Markdown and as one HTML page that needs no other file.

use std::fmt::Write;

use crate::drawing::Svg;

pub enum Block {
    /// Level from 1 to 3, and text.
    Heading(usize, String),
    Paragraph(String),
    List(Vec<String>),
    Table(Table),
    Figure(Figure),
    /// Commands to copy.
    Code(String),
}

pub struct Table {
    pub caption: String,
    pub header: Vec<String>,
    pub rows: Vec<Vec<String>>,
}

pub struct Figure {
    /// Name of the SVG file, without its extension.
    pub name: String,
    pub caption: String,
    pub svg: Svg,
}

pub struct Document {
    pub title: String,
    pub blocks: Vec<Block>,
}

impl Document {
    pub fn figures(&self) -> impl Iterator<Item = &Figure> {
        self.blocks.iter().filter_map(|block| match block {
            Block::Figure(figure) => Some(figure),
            _ => None,
        })
    }

    /// Writes Markdown that links the figures as files beside it.
    pub fn to_markdown(&self) -> String {
        let mut text = format!("# {}\n", self.title);
        for block in &self.blocks {
            text.push('\n');
            match block {
                Block::Heading(level, title) => line(&mut text, format_args!("{} {title}", "#".repeat(*level))),
                Block::Paragraph(words) => line(&mut text, words),
                Block::List(items) => items.iter().for_each(|item| line(&mut text, format_args!("- {item}"))),
                Block::Table(table) => table_to_markdown(&mut text, table),
                Block::Figure(figure) => {
                    let (caption, name) = (&figure.caption, &figure.name);
                    line(&mut text, format_args!("![{caption}]({name}.svg)\n\n{caption}"));
                }
                Block::Code(commands) => line(&mut text, format_args!("```sh\n{commands}\n```")),
            }
        }
        text
    }

    /// Writes one HTML page that contains its figures.
    pub fn to_html(&self) -> String {
        let title = escape(&self.title);
        let mut body = format!("<h1>{title}</h1>\n");
        for block in &self.blocks {
            match block {
                Block::Heading(level, title) => {
                    let (title, id) = (escape(title), anchor(title));
                    line(&mut body, format_args!("<h{level} id=\"{id}\">{title}</h{level}>"));
                }
                Block::Paragraph(words) => line(&mut body, format_args!("<p>{}</p>", escape(words))),
                Block::List(items) => {
                    let items: String = items.iter().map(|item| format!("<li>{}</li>\n", escape(item))).collect();
                    line(&mut body, format_args!("<ul>\n{items}</ul>"));
                }
                Block::Table(table) => table_to_html(&mut body, table),
                Block::Figure(figure) => {
                    let caption = escape(&figure.caption);
                    let svg = figure.svg.inline(&caption);
                    line(&mut body, format_args!("<figure>\n{svg}<figcaption>{caption}</figcaption>\n</figure>"));
                }
                Block::Code(commands) => line(&mut body, format_args!("<pre>{}</pre>", escape(commands))),
            }
        }
        let contents: String = self
            .blocks
            .iter()
            .filter_map(|block| match block {
                Block::Heading(2, title) => Some(format!("<a href=\"#{}\">{}</a>\n", anchor(title), escape(title))),
                _ => None,
            })
            .collect();
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<nav>\n{contents}</nav>\n<main>\n{body}\
             </main>\n</body>\n</html>\n"
        )
    }
}

const STYLE: &str = include_str!("page.css");

fn line(text: &mut String, words: impl std::fmt::Display) {
    writeln!(text, "{words}").expect("a string takes everything");
}

fn table_to_markdown(text: &mut String, table: &Table) {
    let row = |cells: &[String]| {
        let cells: Vec<String> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
        format!("| {} |", cells.join(" | "))
    };
    line(text, format_args!("**{}**\n", table.caption));
    line(text, row(&table.header));
    let rule: Vec<String> =
        table.header.iter().enumerate().map(|(i, _)| if i == 0 { "---" } else { "--:" }.to_owned()).collect();
    line(text, row(&rule));
    table.rows.iter().for_each(|cells| line(text, row(cells)));
}

fn table_to_html(text: &mut String, table: &Table) {
    let row = |tag: &str, cells: &[String]| {
        let cells: String = cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", escape(cell))).collect();
        format!("<tr>{cells}</tr>\n")
    };
    let rows: String = table.rows.iter().map(|cells| row("td", cells)).collect();
    let (caption, header) = (escape(&table.caption), row("th", &table.header));
    line(
        text,
        format_args!(
            "<div class=\"table\"><table>\n<caption>{caption}</caption>\n<thead>\n{header}</thead>\n<tbody>\n{rows}</tbody>\n\
             </table></div>"
        ),
    );
}

/// Returns the HTML id of a heading.
fn anchor(title: &str) -> String {
    title.to_lowercase().chars().map(|c| if c.is_alphanumeric() { c } else { '-' }).collect()
}

/// Escapes a text for HTML and XML.
pub fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_path_may_hold_does_no_harm_to_the_page() {
        let cell = "<b>|\"&".to_owned();
        let table = Table { caption: cell.clone(), header: vec![cell.clone()], rows: vec![vec![cell.clone()]] };
        let blocks = vec![Block::Table(table), Block::Heading(2, cell.clone()), Block::Paragraph(cell)];
        let document = Document { title: "t".to_owned(), blocks };
        let html = document.to_html();
        // Caption, header, cell, heading, the link to it, paragraph.
        assert!(!html.contains("<b>") && html.matches("&lt;b&gt;|&quot;&amp;").count() == 6, "{html}");
        assert!(document.to_markdown().contains("| <b>\\|\"& |"));
    }
}
