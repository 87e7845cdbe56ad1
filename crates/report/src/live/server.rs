//! Gives the page to browsers on this machine that know its address.
//!
//! The server listens on 127.0.0.1 only. Every path begins with a token that is drawn anew each time, and a request
//! must name this machine as its host. So neither another user's guess nor a page of another site can read it.

use std::net::TcpListener;
use std::sync::Arc;
use std::thread;

use anyhow::{Context, Result, bail};
use rand::TryRngCore;
use rand::rngs::OsRng;
use tokio::runtime::{Builder, Runtime};

use super::answers::Answers;
use super::connections::answer_all;
use super::maker::pages;
use super::page::Page;

pub struct LiveServer {
    runtime: Runtime,
    listener: TcpListener,
    host: String,
    token: String,
}

impl LiveServer {
    /// Takes a port of 127.0.0.1. `port` 0: any free one. Another program has it: an error.
    pub fn new(port: u16) -> Result<LiveServer> {
        let listener = TcpListener::bind(("127.0.0.1", port));
        let listener = listener.with_context(|| format!("--port {port}: cannot be used; 0 takes a free one"))?;
        listener.set_nonblocking(true).context("the live view cannot be started")?;
        let port = listener.local_addr().context("the server has no port")?.port();
        let runtime = Builder::new_current_thread().enable_io().enable_time().build();
        let runtime = runtime.context("the live view cannot be started")?;
        let mut token = [0; 16];
        OsRng.try_fill_bytes(&mut token).context("the system gives no random numbers")?;
        let token = token.iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(LiveServer { runtime, listener, host: format!("127.0.0.1:{port}"), token })
    }

    pub fn address(&self) -> String {
        format!("http://{}/{}/", self.host, self.token)
    }

    /// Answers requests until the process ends. Pages are made in this thread, connections are served in another one.
    pub fn serve(self, page: &mut Page, title: &str) -> Result<()> {
        let LiveServer { runtime, listener, host, token } = self;
        let (pages, maker) = pages();
        let answers = Arc::new(Answers::new(host, token, title, pages));
        let listener = {
            let _inside = runtime.enter();
            tokio::net::TcpListener::from_std(listener).context("the live view cannot receive requests")?
        };
        // Not a scoped thread: if making a page panics, the process must end, and not wait for this one.
        let connections = move || runtime.block_on(answer_all(listener, answers));
        thread::Builder::new().spawn(connections).context("the live view cannot be started")?;
        maker.run(|| page.now());
        bail!("the live view cannot receive requests");
    }
}
