/*
 * A plugin of QEMU's user-mode emulator: counts the instructions that an ARM program executes, and what its floating
 * point would cost on a Cortex-A8.
 *
 *     qemu-arm -plugin libcount.so,counts=DIR PROGRAM
 *
 * The counters stand in the file DIR/PID, mapped into memory, where anyone may read them at any time: the program
 * itself too. Counting is by translated block: exact but for blocks that a signal cuts short.
 *
 * Cycles are those of ARM's Cortex-A8 Technical Reference Manual (DDI 0344), table 16.25: the VFPLite is not pipelined,
 * each operation takes its whole time, which depends on the numbers (least and most are both summed). A transfer from
 * the floating-point unit to the core's registers or flags waits for its pipeline: 20 cycles.
 *
 * Debian ships QEMU's plugin loader without its header: the few declarations needed stand here.
 */
#include <fcntl.h>
#include <inttypes.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "counters.h"

typedef uint64_t qemu_plugin_id_t;
struct qemu_plugin_tb;
struct qemu_plugin_insn;
enum { QEMU_PLUGIN_INLINE_ADD_U64 = 0 };
void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t id, void (*)(qemu_plugin_id_t, struct qemu_plugin_tb *));
void qemu_plugin_register_vcpu_tb_exec_inline(struct qemu_plugin_tb *tb, int op, void *ptr, uint64_t imm);
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *tb);
struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *tb, size_t index);
char *qemu_plugin_insn_disas(const struct qemu_plugin_insn *insn);

int qemu_plugin_version = 1;

typedef struct {
    const char *mnemonic; /* without its type */
    int single_least, single_most, double_least, double_most;
} timing_t;

static const timing_t timings[] = {
    {"vadd", 9, 10, 9, 10},   {"vsub", 9, 10, 9, 10},    {"vmul", 10, 12, 11, 17},  {"vnmul", 10, 12, 11, 17},
    {"vmla", 18, 21, 19, 26}, {"vmls", 18, 21, 19, 26},  {"vnmla", 18, 21, 19, 26}, {"vnmls", 18, 21, 19, 26},
    {"vdiv", 20, 37, 29, 65}, {"vsqrt", 19, 33, 29, 60}, {"vabs", 4, 4, 4, 4},      {"vneg", 4, 4, 4, 4},
    {"vmov", 4, 4, 4, 4},     {"vcmp", 4, 7, 4, 7},      {"vcmpe", 4, 7, 4, 7},     {"vcvt", 5, 9, 7, 9},
    {"vcvtr", 5, 9, 7, 9},
};

static uint64_t *counters;

/* Adds what one instruction costs to `sums`; `text` as QEMU disassembles it, e.g. "vmul.f64 d16, d16, d17". */
static void judge(const char *text, uint64_t sums[COUNTERS])
{
    sums[ALL]++;
    if (text == NULL || text[0] != 'v')
        return;
    char name[16] = "", type[16] = "";
    sscanf(text, "%15[a-z].%15[a-z0-9.]", name, type);
    bool to_core = (strncmp(name, "vmov", 4) == 0 && strchr(text, 'r') != NULL && strstr(text, " r") != NULL &&
                    strstr(text, " r") < strchr(text, ',')) ||
                   strncmp(name, "vmrs", 4) == 0;
    if (to_core) {
        sums[TRANSFERS]++;
        return;
    }
    bool is_double = strstr(type, "f64") != NULL;
    if (!is_double && strstr(type, "f32") == NULL)
        return; /* loads, stores, moves of bits */
    for (size_t i = 0; i < sizeof timings / sizeof timings[0]; i++) {
        size_t length = strlen(timings[i].mnemonic);
        /* a condition may follow: vmulgt.f64; vmul is no prefix of another name that is timed differently */
        if (strncmp(name, timings[i].mnemonic, length) != 0 || (name[length] != '\0' && strlen(name) != length + 2))
            continue;
        sums[is_double ? DOUBLES : SINGLES]++;
        sums[is_double ? DOUBLES_LEAST : SINGLES_LEAST] +=
            (uint64_t)(is_double ? timings[i].double_least : timings[i].single_least);
        sums[is_double ? DOUBLES_MOST : SINGLES_MOST] +=
            (uint64_t)(is_double ? timings[i].double_most : timings[i].single_most);
        return;
    }
    sums[OTHERS]++;
}

static void translated(qemu_plugin_id_t id, struct qemu_plugin_tb *tb)
{
    (void)id;
    uint64_t sums[COUNTERS] = {0};
    size_t n = qemu_plugin_tb_n_insns(tb);
    for (size_t i = 0; i < n; i++) {
        char *text = qemu_plugin_insn_disas(qemu_plugin_tb_get_insn(tb, i));
        judge(text, sums);
        free(text);
    }
    for (int i = 0; i < COUNTERS; i++) {
        if (sums[i] > 0)
            qemu_plugin_register_vcpu_tb_exec_inline(tb, QEMU_PLUGIN_INLINE_ADD_U64, &counters[i], sums[i]);
    }
}

int qemu_plugin_install(qemu_plugin_id_t id, const void *info, int argc, char **argv)
{
    (void)info;
    char path[4096];
    if (argc != 1 || strncmp(argv[0], "counts=", 7) != 0) {
        fprintf(stderr, "count_insns: say counts=DIR\n");
        return -1;
    }
    snprintf(path, sizeof path, "%s/%d", argv[0] + 7, (int)getpid());
    int fd = open(path, O_RDWR | O_CREAT | O_TRUNC, 0644);
    if (fd < 0 || ftruncate(fd, COUNTERS * sizeof(uint64_t)) != 0) {
        fprintf(stderr, "count_insns: cannot write %s\n", path);
        return -1;
    }
    counters = mmap(NULL, COUNTERS * sizeof(uint64_t), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    close(fd);
    if (counters == MAP_FAILED)
        return -1;
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    return 0;
}
