//! The memory that an environment shares with the Python process: sections of numbers, one after another.
//!
//! The Python process maps it. This process reads and writes it as a file: a write of some kilobytes costs about a
//! microsecond, and needs no unsafe code. Only one of the two uses it at a time, as the control channel says.

use std::fs::{File, OpenOptions};
use std::ops::Range;
use std::os::unix::fs::FileExt;

use anyhow::{Context, Result};
use bytemuck::{NoUninit, Pod};
use dials_session::machine::free_memory_mib;
use serde_json::{Value, json};

use crate::roads::RoadMemory;

/// Every section begins at a multiple of this, so that no number is split between two cache lines.
const ALIGNMENT: usize = 64;
/// Memory of a machine that does not say how much is free, in MiB.
const UNKNOWN_FREE_MIB: u64 = 1 << 20;

/// Returns the free memory of the machine, in bytes.
pub(crate) fn free_bytes() -> usize {
    let free = free_memory_mib().unwrap_or(UNKNOWN_FREE_MIB) << 20;
    usize::try_from(free).unwrap_or(usize::MAX)
}

/// The shared memory, and a copy of it in which the next state is put together.
pub(crate) struct Memory {
    file: File,
    image: Vec<u8>,
    sections: Vec<(&'static str, Section)>,
    /// Where the actions are. They are not part of what this process writes.
    actions: Range<usize>,
}

/// The place of a table in the memory.
#[derive(Clone, Debug)]
pub(crate) struct Section {
    place: Range<usize>,
    /// Type of its numbers, as numpy names it.
    dtype: &'static str,
}

impl Memory {
    /// Opens the memory that the parent made, by the number of its descriptor in this process.
    pub(crate) fn open(descriptor: i32) -> Result<Memory> {
        // The same memory under a second descriptor, which this process owns.
        let path = format!("/proc/self/fd/{descriptor}");
        let file = OpenOptions::new().read(true).write(true).open(path).context("no shared memory")?;
        Ok(Memory { file, image: Vec::new(), sections: Vec::new(), actions: 0..0 })
    }

    /// Adds a section of `count` numbers of type `T`; `dtype`: the type as numpy names it.
    pub(crate) fn section<T>(&mut self, name: &'static str, count: usize, dtype: &'static str) -> Section {
        let begin = self.image.len().next_multiple_of(ALIGNMENT);
        let place = begin..begin + count * size_of::<T>();
        self.image.resize(place.end, 0);
        let section = Section { place, dtype };
        self.sections.push((name, section.clone()));
        section
    }

    /// Adds the section of the actions, one byte each, and makes the memory as large as all sections. The last call.
    pub(crate) fn finish(mut self, actions: usize) -> Result<Memory> {
        self.actions = self.section::<u8>("actions", actions, "u1").place;
        self.file.set_len(self.image.len() as u64).context("no shared memory of this size")?;
        self.image.truncate(self.actions.start);
        Ok(self)
    }

    /// Describes the sections for the Python process: by name, `[offset, count, dtype]`. The size is that of the memory.
    pub(crate) fn describe(&self) -> Value {
        let numbers = |section: &Section| section.place.len() / section.dtype[1..].parse::<usize>().unwrap_or(1);
        let sections = self
            .sections
            .iter()
            .map(|(name, section)| ((*name).to_owned(), json!([section.place.start, numbers(section), section.dtype])));
        json!({ "size": self.actions.end, "behind": self.size(), "sections": sections.collect::<serde_json::Map<_, _>>() })
    }

    /// Returns the memory behind all sections.
    pub(crate) fn behind(&self) -> Result<RoadMemory> {
        let file = self.file.try_clone().context("no shared memory")?;
        Ok(RoadMemory::new(file, self.size() as u64))
    }

    /// Returns the number of bytes of all sections.
    fn size(&self) -> usize {
        self.actions.end.next_multiple_of(ALIGNMENT)
    }

    /// Puts values into the image.
    pub(crate) fn put<T: NoUninit>(&mut self, section: &Section, values: &[T]) {
        self.image[section.place.clone()].copy_from_slice(bytemuck::cast_slice(values));
    }

    /// Shows the image to the Python process.
    pub(crate) fn show(&self) -> Result<()> {
        self.file.write_all_at(&self.image, 0).context("cannot write the shared memory")
    }

    /// Reads the values that the Python process wrote into a section.
    pub(crate) fn read<T: Pod>(&self, section: &Section, values: &mut [T]) -> Result<()> {
        let bytes = bytemuck::cast_slice_mut(values);
        self.file.read_exact_at(bytes, section.place.start as u64).context("cannot read the shared memory")
    }

    /// Shows actions to the Python process, if this process is the one that decides.
    pub(crate) fn write_actions(&self, actions: &[u8]) -> Result<()> {
        self.file.write_all_at(actions, self.actions.start as u64).context("cannot write the shared memory")
    }

    /// Reads the actions of the Python process.
    pub(crate) fn read_actions(&self, actions: &mut [u8]) -> Result<()> {
        self.file.read_exact_at(actions, self.actions.start as u64).context("cannot read the shared memory")
    }
}
