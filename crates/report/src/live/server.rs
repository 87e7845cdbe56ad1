//! Gives the page to browsers on this machine that know its address.
//!
//! The server listens on 127.0.0.1 only. Every path begins with a token that is drawn anew each time, and a request
//! must name this machine as its host. So neither another user's guess nor a page of another site can read it.

use std::io::Cursor;

use anyhow::{Context, Result, anyhow};
use rand::TryRngCore;
use rand::rngs::OsRng;
use tiny_http::{Header, Method, Request, Response, Server};

use super::page::Page;
use crate::document::{STYLE, escape};

/// The page around what changes, and what asks for the changes.
const SHELL: &str = include_str!("shell.html");
const SCRIPT: &str = include_str!("shell.js");

pub struct LiveServer {
    server: Server,
    host: String,
    token: String,
}

type Answer = Response<Cursor<Vec<u8>>>;

impl LiveServer {
    /// Takes a port of 127.0.0.1. `port` 0: any free one. Another program has it: an error.
    pub fn new(port: u16) -> Result<LiveServer> {
        let server = Server::http(("127.0.0.1", port)).map_err(|error| anyhow!("{error}"));
        let server = server.with_context(|| format!("--port {port}: cannot be used; 0 takes a free one"))?;
        let port = server.server_addr().to_ip().context("the server has no port")?.port();
        let mut token = [0; 16];
        OsRng.try_fill_bytes(&mut token).context("the system gives no random numbers")?;
        let token = token.iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(LiveServer { server, host: format!("127.0.0.1:{port}"), token })
    }

    pub fn address(&self) -> String {
        format!("http://{}/{}/", self.host, self.token)
    }

    /// Answers requests, one after the other, until the process ends.
    pub fn serve(&self, page: &mut Page, title: &str) -> Result<()> {
        loop {
            let request = self.server.recv().context("the live view cannot receive requests")?;
            let answer = self.answer(&request, page, title);
            // A browser that has gone away needs no answer.
            let _ = request.respond(answer);
        }
    }

    fn answer(&self, request: &Request, page: &mut Page, title: &str) -> Answer {
        let host = request.headers().iter().find(|header| header.field.equiv("Host"));
        if host.is_none_or(|host| host.value.as_str() != self.host) {
            return answer(403, "text/plain", "this page is for browsers on this machine only\n".to_owned());
        }
        if *request.method() != Method::Get {
            return answer(405, "text/plain", "this page can only be read\n".to_owned());
        }
        let path = request.url().strip_prefix('/').and_then(|path| path.strip_prefix(&self.token));
        match path {
            Some("/") => {
                let shell = SHELL.replace("{{style}}", STYLE).replace("{{title}}", &escape(title));
                answer(200, "text/html", shell)
            }
            Some("/shell.js") => answer(200, "text/javascript", SCRIPT.to_owned()),
            Some("/now") => answer(200, "text/html", page.now()),
            _ => answer(404, "text/plain", "no such page; the address ends with the token and /\n".to_owned()),
        }
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
    let mut answer = Response::from_string(text).with_status_code(status);
    for (name, value) in headers {
        let header = Header::from_bytes(name, value).expect("names and values are plain ASCII");
        answer.add_header(header);
    }
    answer
}
