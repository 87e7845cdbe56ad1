// What open.cpp and the two builds of shim.cpp say to each other.
#ifndef SUMO_OPEN_H
#define SUMO_OPEN_H

#include "shim.h"

extern "C" {

// What one build of the shim found in a library.
struct found {
    const struct ds_shim *shim;
    const char *version;
    const void *code;    // Where one of SUMO's functions is.
    const char *missing; // Names of functions that the library lacks, with blanks between.
    int count;           // Their number; negative without memory.
    void (*find_inside)(void *library); // Looks for SUMO's insides.
};

struct found ds_bind_old(void *library) noexcept;
struct found ds_bind_new(void *library) noexcept;

// Takes the place of functions that SUMO calls, where it can be reached, and returns the bits of those taken.
void ds_take_detours(void *library) noexcept;
int ds_detours(void) noexcept;

// Writes the shortest decimal that reads back as the same number, and returns its length. Rust has it: std::to_chars needs a
// libstdc++ of 2021.
size_t ds_decimal(double number, char *text, size_t room);

// Keeps the text for ds_last_error(), in lines, and returns 1.
int ds_failed(const char *what, const char *more) noexcept;
}

#endif
