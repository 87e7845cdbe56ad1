//! A report as a list of blocks. It is written as Markdown and as one HTML page that needs no other file.

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
    /// Files beside the page, each with what it is. Names of files are ours: plain words without spaces.
    Links(Vec<(String, String)>),
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
        let blocks: String = self.blocks.iter().map(|block| format!("\n{}\n", block.to_markdown())).collect();
        format!("# {}\n{blocks}", plain_line(&self.title))
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

impl Block {
    fn to_markdown(&self) -> String {
        match self {
            Block::Heading(title) => format!("## {}", plain_line(title)),
            Block::Paragraph(words) => plain_line(words),
            Block::List(items) => joined(items, |item| format!("- {}", plain_line(item))),
            Block::Table(Table { caption, header, rows }) => {
                let row = |cells: &Vec<String>| {
                    let cells: Vec<String> = cells.iter().map(|cell| markdown_cell(cell)).collect();
                    format!("| {} |", cells.join(" | "))
                };
                let rule = format!("| ---{} |", " | --:".repeat(header.len() - 1));
                let lines: Vec<String> = [row(header), rule].into_iter().chain(rows.iter().map(row)).collect();
                format!("**{}**\n\n{}", markdown(caption), lines.join("\n"))
            }
            Block::Figure(Figure { name, caption, .. }) => {
                let caption = markdown(caption);
                format!("![{caption}]({name}.svg)\n\n{caption}")
            }
            Block::Code(commands) => {
                let commands = joined(commands, |command| Printable(command).to_string());
                // A fence of backticks that is not in the text.
                let longest = commands.split(|letter| letter != '`').map(str::len).max().unwrap_or(0);
                let fence = "`".repeat((longest + 1).max(3));
                format!("{fence}sh\n{commands}\n{fence}")
            }
            Block::Links(links) => joined(links, |(file, words)| format!("- [{file}]({file}): {}", markdown(words))),
        }
    }

    fn to_html(&self) -> String {
        match self {
            Block::Heading(title) => format!("<h2 id=\"{}\">{}</h2>", anchor(title), escape(title)),
            Block::Paragraph(words) => format!("<p>{}</p>", escape(words)),
            Block::List(items) => {
                format!("<ul>\n{}\n</ul>", joined(items, |item| format!("<li>{}</li>", escape(item))))
            }
            Block::Table(Table { caption, header, rows }) => {
                let row = |tag: &str, cells: &[String]| {
                    let cells: String = cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", escape(cell))).collect();
                    format!("<tr>{cells}</tr>\n")
                };
                let rows: String = rows.iter().map(|cells| row("td", cells)).collect();
                format!(
                    "<div class=\"table\"><table>\n<caption>{}</caption>\n<thead>\n{}</thead>\n<tbody>\n{rows}</tbody>\n\
                     </table></div>",
                    escape(caption),
                    row("th", header)
                )
            }
            Block::Figure(Figure { caption, svg, .. }) => {
                let caption = escape(caption);
                format!("<figure>\n{}<figcaption>{caption}</figcaption>\n</figure>", svg.inline(&caption))
            }
            Block::Code(commands) => format!("<pre>{}</pre>", joined(commands, |command| escape(command))),
            Block::Links(links) => {
                let link = |(file, words): &(String, String)| {
                    format!("<li><a href=\"{0}\">{0}</a>: {1}</li>", escape(file), escape(words))
                };
                format!("<ul>\n{}\n</ul>", joined(links, link))
            }
        }
    }
}

fn joined<T>(items: &[T], line: impl Fn(&T) -> String) -> String {
    items.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// Writes blocks as HTML, to be put into a page with [`STYLE`].
pub(crate) fn to_html(blocks: &[Block]) -> String {
    blocks.iter().map(|block| block.to_html() + "\n").collect()
}

pub(crate) const STYLE: &str = include_str!("page.css");

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
