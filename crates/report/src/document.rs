//! A report as a list of blocks. It is written as Markdown and as one HTML page that needs no other file.

use std::fmt::Display;

use crate::drawing::Svg;
use dials_core::outside::{Printable, is_printable};

pub(crate) enum Block {
    Heading(String),
    Paragraph(String),
    List(Vec<String>),
    Table(Table),
    Figure(Figure),
    /// Commands to copy, one line each.
    Code(Vec<String>),
}

pub(crate) struct Table {
    pub(crate) caption: String,
    pub(crate) header: Vec<String>,
    pub(crate) rows: Vec<Vec<String>>,
}

#[derive(Clone)]
pub(crate) struct Figure {
    /// Name of the SVG file, without its extension.
    pub(crate) name: String,
    pub(crate) caption: String,
    pub(crate) svg: Svg,
}

pub(crate) struct Document {
    pub(crate) title: String,
    pub(crate) blocks: Vec<Block>,
}

impl Document {
    pub(crate) fn figures(&self) -> impl Iterator<Item = &Figure> {
        self.blocks.iter().filter_map(|block| match block {
            Block::Figure(figure) => Some(figure),
            _ => None,
        })
    }

    /// Writes Markdown that links the figures as files beside it.
    pub(crate) fn to_markdown(&self) -> String {
        let mut text = format!("# {}\n", plain_line(&self.title));
        for block in &self.blocks {
            text.push('\n');
            match block {
                Block::Heading(title) => line(&mut text, format_args!("## {}", plain_line(title))),
                Block::Paragraph(words) => line(&mut text, plain_line(words)),
                Block::List(items) => {
                    items.iter().for_each(|item| line(&mut text, format_args!("- {}", plain_line(item))))
                }
                Block::Table(table) => table_to_markdown(&mut text, table),
                Block::Figure(figure) => {
                    let (caption, name) = (markdown(&figure.caption), &figure.name);
                    line(&mut text, format_args!("![{caption}]({name}.svg)\n\n{caption}"));
                }
                Block::Code(commands) => {
                    let lines = commands.iter().map(|command| Printable(command).to_string());
                    let commands = lines.collect::<Vec<_>>().join("\n");
                    // A fence of backticks that is not in the text.
                    let longest = commands.split(|letter| letter != '`').map(str::len).max().unwrap_or(0);
                    let fence = "`".repeat((longest + 1).max(3));
                    line(&mut text, format_args!("{fence}sh\n{commands}\n{fence}"));
                }
            }
        }
        text
    }

    /// Writes one HTML page that contains its figures.
    pub(crate) fn to_html(&self) -> String {
        let title = escape(&self.title);
        let body = format!("<h1>{title}</h1>\n{}", to_html(&self.blocks));
        let contents: String = self
            .blocks
            .iter()
            .filter_map(|block| match block {
                Block::Heading(title) => Some(format!("<a href=\"#{}\">{}</a>\n", anchor(title), escape(title))),
                _ => None,
            })
            .collect();
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
             <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<nav>\n{contents}</nav>\n<main>\n{body}\
             </main>\n</body>\n</html>\n"
        )
    }
}

/// Writes blocks as HTML, to be put into a page with [`STYLE`].
pub(crate) fn to_html(blocks: &[Block]) -> String {
    let mut body = String::new();
    for block in blocks {
        match block {
            Block::Heading(title) => {
                let (title, id) = (escape(title), anchor(title));
                line(&mut body, format_args!("<h2 id=\"{id}\">{title}</h2>"));
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
            Block::Code(commands) => {
                let commands: Vec<String> = commands.iter().map(|command| escape(command)).collect();
                line(&mut body, format_args!("<pre>{}</pre>", commands.join("\n")));
            }
        }
    }
    body
}

pub(crate) const STYLE: &str = include_str!("page.css");

fn line(text: &mut String, words: impl Display) {
    *text += &format!("{words}\n");
}

fn table_to_markdown(text: &mut String, table: &Table) {
    let row = |cells: &[String]| {
        let cells: Vec<String> = cells.iter().map(|cell| markdown_cell(cell)).collect();
        format!("| {} |", cells.join(" | "))
    };
    line(text, format_args!("**{}**\n", markdown(&table.caption)));
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

fn anchor(title: &str) -> String {
    title.to_lowercase().chars().map(|c| if c.is_alphanumeric() { c } else { '-' }).collect()
}

/// Escapes a text of one line for Markdown: no name in it is markup, a link or an image.
///
/// Two things that our own sentences use stay: a few words between backticks, and brackets around numbers.
fn markdown(text: &str) -> String {
    let text = Printable(text).to_string();
    let mut escaped = String::with_capacity(text.len());
    let mut rest = &text[..];
    while let Some(letter) = rest.chars().next() {
        let quoted = between_backticks(rest);
        let part = &rest[..quoted.unwrap_or(letter.len_utf8())];
        let next = rest[part.len()..].chars().next();
        match letter {
            '`' if quoted.is_some() => escaped += part,
            '<' => escaped += "&lt;",
            '&' => escaped += "&amp;",
            '\\' | '`' | '*' | '~' => escaped.extend(['\\', letter]),
            // A link, an image, or the definition of one.
            ']' if matches!(next, Some('(' | '[' | ':')) => escaped += "\\]",
            _ => escaped.push(letter),
        }
        rest = &rest[part.len()..];
    }
    escaped
}

/// Escapes a text at the beginning of a line for Markdown: no name makes it a heading, a list, a quotation or a rule.
fn plain_line(text: &str) -> String {
    let escaped = markdown(text);
    if escaped.starts_with(['#', '>', '+', '-', '=']) { format!("\\{escaped}") } else { escaped }
}

/// Escapes the text of a cell: no name in it ends the cell.
fn markdown_cell(text: &str) -> String {
    markdown(text).replace('|', "\\|")
}

/// Most characters between two backticks that stay.
const QUOTED: usize = 60;

/// Returns the length of a few plain words between backticks at the beginning of a text, if there are any.
fn between_backticks(text: &str) -> Option<usize> {
    let (words, _) = text.strip_prefix('`')?.split_once('`')?;
    let plain = (1..=QUOTED).contains(&words.len()) && !words.contains(['<', '>', '&', '[', ']', '|', '\\']);
    plain.then_some(words.len() + 2)
}

/// Escapes a text of one line for HTML and XML.
pub(crate) fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            c if is_printable(c) => escaped.push(c),
            c => escaped.extend(c.escape_default()),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_name_is_markup_in_markdown() {
        for (name, message) in [
            ("<script>alert(1)</script>", "&lt;script>alert(1)&lt;/script>"),
            ("![x](http://a)", "![x\\](http://a)"),
            ("[x]: http://a", "[x\\]: http://a"),
            ("a\\](http://b)", "a\\\\\\](http://b)"),
            ("&lt;b", "&amp;lt;b"),
            ("`<b>`", "\\`&lt;b>\\`"),
            ("two\nlines\u{1b}[1m\u{202e}", "two\\\\nlines\\\\u{1b}[1m\\\\u{202e}"),
            ("-3.00", "-3.00"),
            ("=cmd()|*b*", "=cmd()|\\*b\\*"),
            ("runs/a_b-c", "runs/a_b-c"),
            ("`ppo.clip` 95 % [1.0, 2.0] + 1 - 2", "`ppo.clip` 95 % [1.0, 2.0] + 1 - 2"),
            ("-", "-"),
        ] {
            assert_eq!(markdown(name), message);
        }
        assert_eq!(["a|b", "a\\|`b|c`"].map(markdown_cell), ["a\\|b", "a\\\\\\|\\`b\\|c\\`"]);
        assert_eq!(["# a", "> a", "- a", "a - b"].map(plain_line), ["\\# a", "\\> a", "\\- a", "a - b"]);
    }
}
