//! The allocator of the program: the system's, but memory that it refuses is an error with a way out.
//!
//! Rust's own answer is an abort, which a coordinator would take for an assertion inside SUMO.

#![allow(unsafe_code, reason = "an allocator is unsafe by its trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Write;
use std::os::fd::AsFd;

use super::signals::end_now;
use super::way_out::{LessMemory, option_for_processes};

/// The allocator that `main` registers.
pub struct Allocator;

// SAFETY: every call goes to the system's allocator unchanged. Its result is passed on, or the process ends.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise.
        checked(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise.
        checked(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: the caller's promise.
        checked(unsafe { System.realloc(memory, layout, size) }, size)
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[inline]
fn checked(memory: *mut u8, size: usize) -> *mut u8 {
    if memory.is_null() {
        refused(size);
    }
    memory
}

/// Ends the process with exit code 1. Takes no memory and waits for no lock.
#[cold]
fn refused(size: usize) -> ! {
    let mut line = [0; 256];
    let mut rest = &mut line[..];
    let _ = writeln!(
        rest,
        "error: out of memory: the system refused {size} more bytes\n  way out: {}",
        LessMemory(option_for_processes())
    );
    let left = rest.len();
    // The file itself, because the lock of standard error may be held.
    let _ = rustix::io::write(std::io::stderr().as_fd(), &line[..line.len() - left]);
    end_now(1)
}
