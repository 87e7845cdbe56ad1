// Functions that take the place of others that SUMO calls: shortcuts.rs says what for.
//
// SUMO calls functions through its table of their addresses (System V ABI, "Procedure Linkage Table"). An entry there is replaced.

#include "open.h"
#include "shim.h"

#include <cstring>

#include <dlfcn.h>
#include <link.h>
#include <sys/mman.h>
#include <unistd.h>

namespace {

#define DEVICES "19buildVehicleDevicesER11SUMOVehicleRSt6vectorIP15MSVehicleDeviceSaIS4_EE"

using Builder = void (*)(void *vehicle, void *devices);
Builder all = nullptr, trips = nullptr, routes = nullptr;
bool is_few = false;
int taken = 0;

// In SUMO's order: trips before routes.
void build(void *vehicle, void *devices) {
    if (!is_few) {
        return all(vehicle, devices);
    }
    trips(vehicle, devices);
    routes(vehicle, devices);
}

// SUMO translates the texts of its messages, also those that it then does not need: one for each car in each step. No language is
// set in a process of ours, and in others SUMO's words are better understood in English.
char *untranslated(const char *text) { return const_cast<char *>(text); }

// The part of a library that the loader has made read-only after it filled it in.
struct Sealed {
    ElfW(Addr) base, begin, end;
};

int find_sealed(struct dl_phdr_info *info, size_t, void *data) {
    auto &sealed = *static_cast<Sealed *>(data);
    if (info->dlpi_addr != sealed.base) {
        return 0;
    }
    for (int i = 0; i < info->dlpi_phnum; ++i) {
        const auto &part = info->dlpi_phdr[i];
        if (part.p_type == PT_GNU_RELRO) {
            sealed.begin = sealed.base + part.p_vaddr;
            sealed.end = sealed.begin + part.p_memsz;
        }
    }
    return 1;
}

// Returns the entry of a function in the library's table. The library has it once or not at all.
void **entry_of(const struct link_map &map, const char *symbol) {
    // glibc has made these addresses absolute.
    const auto at = [&](ElfW(Addr) address) { return address < map.l_addr ? address + map.l_addr : address; };
    const ElfW(Rela) *entries = nullptr;
    const ElfW(Sym) *symbols = nullptr;
    const char *names = nullptr;
    size_t bytes = 0;
    bool are_whole = false;
    for (const ElfW(Dyn) *part = map.l_ld; part->d_tag != DT_NULL; ++part) {
        switch (part->d_tag) {
        case DT_JMPREL: entries = reinterpret_cast<const ElfW(Rela) *>(at(part->d_un.d_ptr)); break;
        case DT_PLTRELSZ: bytes = part->d_un.d_val; break;
        case DT_PLTREL: are_whole = part->d_un.d_val == DT_RELA; break;
        case DT_SYMTAB: symbols = reinterpret_cast<const ElfW(Sym) *>(at(part->d_un.d_ptr)); break;
        case DT_STRTAB: names = reinterpret_cast<const char *>(at(part->d_un.d_ptr)); break;
        default: break;
        }
    }
    if (entries == nullptr || symbols == nullptr || names == nullptr || !are_whole) {
        return nullptr;
    }
    for (size_t i = 0; i < bytes / sizeof *entries; ++i) {
        const auto number = entries[i].r_info >> (sizeof(entries[i].r_info) == 8 ? 32 : 8);
        if (std::strcmp(names + symbols[number].st_name, symbol) == 0) {
            return reinterpret_cast<void **>(map.l_addr + entries[i].r_offset);
        }
    }
    return nullptr;
}

// Writes an entry, also where the loader has sealed it. Returns whether that was possible.
bool replace(void **entry, void *address, const Sealed &sealed) {
    const auto place = reinterpret_cast<ElfW(Addr)>(entry);
    const auto page = static_cast<ElfW(Addr)>(sysconf(_SC_PAGESIZE));
    void *const begin = reinterpret_cast<void *>(place / page * page);
    const bool is_sealed = place >= sealed.begin && place < sealed.end;
    if (is_sealed && mprotect(begin, page, PROT_READ | PROT_WRITE) != 0) {
        return false;
    }
    *entry = address;
    if (is_sealed) {
        mprotect(begin, page, PROT_READ);
    }
    return true;
}

} // namespace

void ds_take_detours(void *library) noexcept {
    static const char devices[] = "_ZN8MSDevice" DEVICES;
    const auto builder = [=](const char *name) { return reinterpret_cast<Builder>(dlsym(library, name)); };
    all = builder(devices);
    trips = builder("_ZN17MSDevice_Tripinfo" DEVICES);
    routes = builder("_ZN16MSDevice_Routing" DEVICES);
    struct link_map *map = nullptr;
    if (dlinfo(library, RTLD_DI_LINKMAP, &map) != 0) {
        return;
    }
    Sealed sealed = {map->l_addr, 0, 0};
    if (dl_iterate_phdr(find_sealed, &sealed) != 1) {
        return;
    }
    const auto take = [&](const char *symbol, void *function) {
        void **const entry = entry_of(*map, symbol);
        return entry != nullptr && replace(entry, function, sealed);
    };
    if (all != nullptr && trips != nullptr && routes != nullptr && take(devices, reinterpret_cast<void *>(build))) {
        taken |= DS_DEVICES;
    }
    if (take("gettext", reinterpret_cast<void *>(untranslated))) {
        taken |= DS_TEXTS;
    }
}

int ds_detours(void) noexcept { return taken; }

void ds_few_devices(int few) { is_few = few != 0; }
