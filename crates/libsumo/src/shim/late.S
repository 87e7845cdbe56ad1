/* libsumo's functions, found when SUMO is first needed.
 *
 * libsumo brings 220 shared libraries. If it were linked, every start of the program would load them, even for --help.
 * So nothing links it. Each function of libsumo that the shim calls is defined here, and jumps to the address that
 * ds_open() has found. The compiler of the shim knows nothing of that. build.rs writes sumo_calls.inc: a line
 * `late NAME` for each of these functions. On other processors the list is empty, and libsumo is linked. */

#ifdef __x86_64__
    /* A name, the place of an address, and the function that jumps there. */
    .macro late name
    .section .rodata.dials_sumo, "a"
1:  .asciz "\name"
    .section .data.rel.ro.dials_sumo, "aw"
    .quad 1b
    .section .bss.dials_sumo, "aw", %nobits
2:  .quad 0
    .text
    .globl \name
    .hidden \name
    .type \name, %function
\name:
    jmp *2b(%rip)
    .size \name, . - \name
    .endm
#endif

    /* const char *const dials_sumo_names[], with a null at the end; void *dials_sumo_addresses[], in the same order. */
    .section .data.rel.ro.dials_sumo, "aw"
    .balign 8
    .globl dials_sumo_names
    .hidden dials_sumo_names
dials_sumo_names:
    .section .bss.dials_sumo, "aw", %nobits
    .balign 8
    .globl dials_sumo_addresses
    .hidden dials_sumo_addresses
dials_sumo_addresses:

#include "sumo_calls.inc"

    .section .data.rel.ro.dials_sumo, "aw"
    .quad 0
    .section .note.GNU-stack, "", %progbits
