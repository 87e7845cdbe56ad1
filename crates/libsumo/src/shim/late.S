/* libsumo's functions, found when SUMO is first needed. `library.rs` says why.
 *
 * Nothing links libsumo. Each function of libsumo that the shim calls is defined here, and jumps to the address that
 * ds_open() has found. The compiler of the shim knows nothing of that. build.rs writes sumo_calls.inc: a line
 * `late NAME` for each of these functions. On other processors the list is empty, and libsumo is linked. */

#ifdef __x86_64__
    /* A name, the place of an address, and the function that jumps there. */
    .macro late name
    .section .rodata.late, "a"
1:  .asciz "\name"
    .section .data.rel.ro.late, "aw"
    .quad 1b
    .section .bss.late, "aw", %nobits
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

    /* const char *const sumo_late_names[], with a null at the end; void *sumo_late_addresses[], in the same order. */
    .section .data.rel.ro.late, "aw"
    .balign 8
    .globl sumo_late_names
    .hidden sumo_late_names
sumo_late_names:
    .section .bss.late, "aw", %nobits
    .balign 8
    .globl sumo_late_addresses
    .hidden sumo_late_addresses
sumo_late_addresses:

#include "sumo_calls.inc"

    .section .data.rel.ro.late, "aw"
    .quad 0
    .section .note.GNU-stack, "", %progbits
