// Opens SUMO's library, and chooses the build of the shim that fits its std::string.

#include "open.h"

#include <cstdio>
#include <string>

#include <dlfcn.h>
#include <sys/mman.h>
#include <unistd.h>
#ifdef __GLIBC__
#include <gnu/libc-version.h>
#endif

// The headers of libstdc++ ask whether there is one thread, to count without locks. glibc says so from 2.32 on. This one is
// for the shim alone, says no, and so the shim needs no newer glibc.
extern "C" {
__attribute__((visibility("hidden"))) char __libc_single_threaded = 0;
}

namespace {

thread_local std::string last_error;

// The library that is open, and what finds its insides.
void *sumo = nullptr;
void (*find_inside)(void *library) = nullptr;

// Functions of other libraries are looked for when they are first called, as in a program that links libsumo.
void *opened(const char *library) { return dlopen(library, RTLD_LAZY | RTLD_LOCAL); }

} // namespace

int ds_failed(const char *what, const char *more) noexcept {
    try {
        last_error.assign(what).append("\n").append(more);
    } catch (...) {
        last_error.clear(); // Out of memory.
    }
    return 1;
}

const char *ds_last_error(void) { return last_error.c_str(); }

int ds_open_bytes(const void *bytes, size_t size) {
    const int file = memfd_create("stand_in", MFD_CLOEXEC);
    if (file < 0 || write(file, bytes, size) != static_cast<ssize_t>(size)) {
        return ds_failed("there is no memory for a stand-in", "");
    }
    char path[64];
    std::snprintf(path, sizeof path, "/proc/self/fd/%d", file);
    // It stays open: the loader would take another file with the same path for this one.
    return opened(path) == nullptr ? ds_failed(dlerror(), "") : 0;
}

int ds_open(const char *library, const struct ds_shim **shim, const char **version, const char **file) {
    void *const handle = opened(library);
    if (handle == nullptr) {
        return ds_failed(dlerror(), "");
    }
    const struct found old_strings = ds_bind_old(handle), new_strings = ds_bind_new(handle);
    const struct found &best = old_strings.count < new_strings.count ? old_strings : new_strings;
    if (best.count > 0) {
        ds_failed(best.missing, "");
        return 2;
    }
    sumo = handle;
    find_inside = best.find_inside;
    *shim = best.shim;
    *version = best.version;
    Dl_info info;
    *file = best.code != nullptr && dladdr(best.code, &info) != 0 && info.dli_fname != nullptr ? info.dli_fname : library;
    return best.count == 0 ? 0 : ds_failed("out of memory", "");
}

void ds_take_shortcuts(void) {
    find_inside(sumo);
    ds_take_detours(sumo);
}

const char *ds_own_file(void) {
    Dl_info info;
    return dladdr(reinterpret_cast<void *>(&ds_own_file), &info) != 0 && info.dli_fname != nullptr ? info.dli_fname : "";
}

const char *ds_c_library(void) {
#ifdef __GLIBC__
    return gnu_get_libc_version();
#else
    return "";
#endif
}
