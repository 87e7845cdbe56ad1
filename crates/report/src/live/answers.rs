//! Which request gets what: the rules about host, method and token, and the headers of every answer.

use hyper::body::Body;
use hyper::header::{HOST, HeaderValue};
use hyper::{Method, Request, Response};
use tokio::sync::watch::error::RecvError;

use super::maker::Pages;
use crate::document::{STYLE, escape};

/// The page around what changes, and what asks for the changes.
const SHELL: &str = include_str!("shell.html");
const SCRIPT: &str = include_str!("shell.js");

pub(super) type Answer = Response<String>;

pub(super) struct Answers {
    host: String,
    token: String,
    shell: String,
    pages: Pages,
}

/// What a browser may ask for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Part {
    Shell,
    Script,
    /// What changes.
    Now,
}

/// Status and text of an answer to those who may not have the page.
pub(super) struct Refusal(u16, &'static str);

impl Refusal {
    pub(super) fn answer(self) -> Answer {
        answer(self.0, "text/plain", self.1.to_owned())
    }
}

impl Answers {
    /// `host`: name and port of this server, as browsers write it.
    pub(super) fn new(host: String, token: String, title: &str, pages: Pages) -> Answers {
        let shell = SHELL.replace("{{style}}", STYLE).replace("{{title}}", &escape(title));
        Answers { host, token, shell, pages }
    }

    /// Returns what a request asks for. Looks at nothing but the header.
    pub(super) fn part<B: Body>(&self, request: &Request<B>) -> Result<Part, Refusal> {
        let refuse = |status, text| Err(Refusal(status, text));
        if request.headers().get_all(HOST).iter().ne([self.host.as_str()]) {
            return refuse(403, "this page is for browsers on this machine only\n");
        }
        if *request.method() != Method::GET {
            return refuse(405, "this page can only be read\n");
        }
        if !request.body().is_end_stream() {
            return refuse(413, "a request for this page has no body\n");
        }
        let address = request.uri().to_string();
        match address.strip_prefix('/').and_then(|path| path.strip_prefix(&self.token)) {
            Some("/") => Ok(Part::Shell),
            Some("/shell.js") => Ok(Part::Script),
            Some("/now") => Ok(Part::Now),
            _ => refuse(404, "no such page; the address ends with the token and /\n"),
        }
    }

    /// Returns a part of the page. Nobody makes pages any more: an error.
    pub(super) async fn give(&self, part: Part) -> Result<Answer, RecvError> {
        Ok(match part {
            Part::Shell => answer(200, "text/html", self.shell.clone()),
            Part::Script => answer(200, "text/javascript", SCRIPT.to_owned()),
            Part::Now => answer(200, "text/html", self.pages.page().await?),
        })
    }
}

/// Makes an answer that no other site can use, and that no browser keeps.
fn answer(status: u16, kind: &str, text: String) -> Answer {
    let rules = "default-src 'none'; style-src 'unsafe-inline'; script-src 'self'; connect-src 'self'; \
                 base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
    let headers = [
        ("Content-Type", format!("{kind}; charset=utf-8")),
        ("Content-Security-Policy", rules.to_owned()),
        ("X-Content-Type-Options", "nosniff".to_owned()),
        ("Referrer-Policy", "no-referrer".to_owned()),
        ("Cache-Control", "no-store".to_owned()),
    ];
    let answer = headers.into_iter().fold(Response::builder().status(status), |answer, (name, value)| {
        answer.header(name, HeaderValue::try_from(value).expect("values are plain ASCII"))
    });
    answer.body(text).expect("names are plain ASCII")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::maker::pages;

    /// Returns the part, or the status of the refusal.
    fn asked(method: &str, uri: &str, hosts: &[&str], body: &str) -> Result<Part, u16> {
        let answers = Answers::new("127.0.0.1:80".to_owned(), "cafe".to_owned(), "runs", pages().0);
        let request = hosts.iter().fold(Request::builder(), |request, host| request.header(HOST, *host));
        let request = request.method(method).uri(uri).body(body.to_owned()).unwrap();
        answers.part(&request).map_err(|Refusal(status, _)| status)
    }

    #[test]
    fn a_part_is_for_those_who_name_host_and_token_and_send_nothing() {
        let host = "127.0.0.1:80";
        for (method, uri, hosts, body, expected) in [
            ("GET", "/cafe/", &[host][..], "", Ok(Part::Shell)),
            ("GET", "/cafe/shell.js", &[host], "", Ok(Part::Script)),
            ("GET", "/cafe/now", &[host], "", Ok(Part::Now)),
            ("GET", "/cafe/now", &[], "", Err(403)),
            ("GET", "/cafe/now", &["evil.example"], "", Err(403)),
            ("GET", "/cafe/now", &[host, "evil.example"], "", Err(403)),
            ("HEAD", "/cafe/now", &[host], "", Err(405)),
            ("POST", "/cafe/now", &[host], "x", Err(405)),
            ("GET", "/cafe/now", &[host], "x", Err(413)),
            ("GET", "/cafe", &[host], "", Err(404)),
            ("GET", "/cafe/now?", &[host], "", Err(404)),
            ("GET", "//cafe/now", &[host], "", Err(404)),
            ("GET", "/beef/now", &[host], "", Err(404)),
            ("GET", "http://127.0.0.1:80/cafe/now", &[host], "", Err(404)),
        ] {
            assert_eq!(asked(method, uri, hosts, body), expected, "{method} {uri} {hosts:?} {body:?}");
        }
    }
}
