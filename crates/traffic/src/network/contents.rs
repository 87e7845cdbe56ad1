//! A network, read once.
//!
//! What was checked is what SUMO loads, what copies hold and what recordings show, even if somebody changes the files
//! meanwhile.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use super::files::{NetworkFiles, config};
use super::loadable::Loadable;
use super::roads::Roads;
use super::tree::{Element, is_utf8, parse_file, read_whole};
use super::way_out::{Role, cannot_be_simulated, no_such_network};
use super::{other_files, xml};
use crate::controllers::actuated;
use crate::sim::options;
use dials_core::outside::write_together;

#[derive(Debug)]
pub(crate) struct Content {
    pub(crate) bytes: Vec<u8>,
    pub(crate) root: Element,
}

impl Content {
    /// Reads a file. If SUMO, given this file, would open another one: an error.
    pub(crate) fn read(path: &Path) -> Result<Content> {
        let content = Content::parse(path)?;
        other_files::refuse(path, &content.root)?;
        Ok(content)
    }

    /// Reads a file that SUMO will not get.
    pub(crate) fn parse(path: &Path) -> Result<Content> {
        let bytes = read_whole(path)?;
        let mut content = Content { root: parse_file(path, &bytes)?, bytes };
        // SUMO might read other elements in another encoding than this program has read.
        if !is_utf8(&content.bytes) {
            content.rewrite();
        }
        Ok(content)
    }

    /// Takes the bytes of copies from the elements.
    pub(crate) fn rewrite(&mut self) {
        self.bytes = xml::text(&self.root).into_bytes();
    }

    pub(crate) fn changed(&self, change: impl FnOnce(&mut Element)) -> Content {
        let mut root = self.root.clone();
        change(&mut root);
        Content { bytes: xml::text(&root).into_bytes(), root }
    }

    /// Returns the text that SUMO loads: the elements that were read, and nothing else of the file.
    pub(crate) fn text(&self) -> String {
        xml::text(&self.root)
    }
}

#[derive(Clone, Debug)]
pub struct Network {
    pub(crate) files: NetworkFiles,
    pub(crate) net: Arc<Content>,
    pub(crate) routes: Arc<Content>,
    pub(crate) actuated: Arc<Content>,
}

impl Network {
    /// Reads all files of a network but the configuration, which this program neither reads nor loads.
    pub fn read(files: &NetworkFiles, role: Role) -> Result<Network> {
        ensure!(files.net.exists(), no_such_network(&files.net));
        let net = Content::read(&files.net)?;
        let root = &net.root.name;
        ensure!(root == "net", "{}: is not a SUMO network: its root is <{root}>, not <net>", files.net.display());
        let way_out = || cannot_be_simulated(&files.net, role);
        let beside = |path: &Path| Content::read(path).with_context(way_out).map(Arc::new);
        Ok(Network {
            files: files.clone(),
            net: Arc::new(net),
            routes: beside(&files.routes)?,
            actuated: beside(&files.actuated)?,
        })
    }

    pub(crate) fn roads(&self) -> Result<Roads> {
        Roads::read(&self.net.root).with_context(|| self.files.net.display().to_string())
    }

    /// Returns the CRC-32 of what determines roads and cars: the net and its routes.
    pub(crate) fn checksum(&self) -> u32 {
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&self.net.bytes);
        hasher.update(&self.routes.bytes);
        hasher.finalize()
    }

    /// Copies the network into another directory under another name, for a run directory that needs nothing outside of
    /// itself. Writes the file for `sumo -c` anew, because it names the others.
    pub fn copy_to(&self, dir: &Path, name: &str) -> Result<NetworkFiles> {
        let copy = NetworkFiles::of(&dir.join(name));
        let contents = [
            (copy.net.clone(), self.net.bytes.clone()),
            (copy.routes.clone(), self.routes.bytes.clone()),
            (copy.actuated.clone(), self.actuated.bytes.clone()),
            (copy.config.clone(), config(name).into_bytes()),
        ];
        write_together(dir, &contents)?;
        Ok(copy)
    }

    pub(crate) fn for_sumo(&self) -> Result<Loadable> {
        let NetworkFiles { net, routes, actuated, .. } = &self.files;
        let loadable = Loadable::new(
            actuated::PROGRAM,
            (&self.net.text(), net),
            &[(self.routes.text(), routes.clone())],
            &[],
            (&self.actuated.text(), actuated),
        )?;
        Ok(loadable.with(options::TIME))
    }
}
