/*
 * An Arduino Uno (simavr) with a simulated CMPS11: runs the firmware and prints, as a recording, what it says.
 *
 *     simulated-board compass.elf < SCENARIO > RECORDING
 *
 * A scenario has one line an event: SECONDS STATE [BEARING PITCH ROLL], bearing in tenths of a degree, the angles in
 * degrees, from that moment on. States: ok; unplugged (nobody answers); floating (answers, but every byte is 255);
 * stuck (holds SDA low until it has seen nine clocks, then is ok); hang (the program runs into an endless loop); end.
 */
#include <inttypes.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <avr_ioport.h>
#include <avr_twi.h>
#include <avr_uart.h>
#include <sim_avr.h>
#include <sim_elf.h>

enum { MAX_EVENTS = 4096, CMPS11_ADDRESS = 0xC0, TWI_VECTOR = 24, SDA_PIN = 4, SCL_PIN = 5, CLOCKS_TO_LET_GO = 9 };

typedef struct {
    double t_s;
    char state[16];
    int bearing_tenths, pitch_deg, roll_deg;
} event_t;

typedef struct {
    avr_t *avr;
    avr_irq_t *twi;           /* first of the bus's signals */
    avr_irq_t *sda;           /* the pin, as the program reads it */
    avr_int_vector_t *vector; /* the bus's interrupt */
    event_t now;
    bool addressed, register_known;
    uint8_t selected;
    int clocks; /* seen while it holds SDA */
    char line[128];
    size_t length;
} board_t;

static uint8_t register_of(const board_t *board, uint8_t number)
{
    if (strcmp(board->now.state, "floating") == 0)
        return 0xFF;
    switch (number) {
    case 1:
        return (uint8_t)(board->now.bearing_tenths * 256 / 3600);
    case 2:
        return (uint8_t)(board->now.bearing_tenths >> 8);
    case 3:
        return (uint8_t)board->now.bearing_tenths;
    case 4:
        return (uint8_t)board->now.pitch_deg;
    case 5:
        return (uint8_t)board->now.roll_deg;
    default:
        return 0;
    }
}

/* The CMPS11 on the bus: the first byte written selects a register, reads go on from there. */
static void on_twi(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    board_t *board = param;
    avr_twi_msg_irq_t message = {.u.v = value};
    if (message.u.twi.msg & TWI_COND_STOP)
        board->addressed = false;
    if (message.u.twi.msg & TWI_COND_START) {
        board->addressed = (message.u.twi.addr & 0xFE) == CMPS11_ADDRESS && strcmp(board->now.state, "unplugged") != 0;
        board->register_known = false;
        if (board->addressed)
            avr_raise_irq(board->twi + TWI_IRQ_INPUT, avr_twi_irq_msg(TWI_COND_ACK, CMPS11_ADDRESS, 1));
    }
    if (!board->addressed)
        return;
    if (message.u.twi.msg & TWI_COND_WRITE) {
        avr_raise_irq(board->twi + TWI_IRQ_INPUT, avr_twi_irq_msg(TWI_COND_ACK, CMPS11_ADDRESS, 1));
        if (!board->register_known)
            board->selected = message.u.twi.data;
        board->register_known = true;
    }
    if (message.u.twi.msg & TWI_COND_READ) {
        uint8_t byte = register_of(board, board->selected++);
        avr_raise_irq(board->twi + TWI_IRQ_INPUT, avr_twi_irq_msg(TWI_COND_READ, CMPS11_ADDRESS, byte));
    }
}

/* The program drives a line low by making its pin an output: each time it does so with SCL is a clock. */
static void on_directions(struct avr_irq_t *irq, uint32_t value, void *param)
{
    board_t *board = param;
    bool falls = (value & 1u << SCL_PIN) && !(irq->value & 1u << SCL_PIN);
    if (strcmp(board->now.state, "stuck") != 0 || !falls || ++board->clocks < CLOCKS_TO_LET_GO)
        return;
    strcpy(board->now.state, "ok");
    fprintf(stderr, "SDA let go after %d clocks\n", board->clocks);
    avr_raise_irq(board->sda, 1);
}

/* Bytes of the serial port become the lines of a recording, stamped when their last byte has been sent. */
static void on_uart(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    board_t *board = param;
    if (value == '\n') {
        uint64_t t_us = board->avr->cycle * 1000000 / board->avr->frequency;
        size_t length = board->length > 0 && board->line[board->length - 1] == '\r' ? board->length - 1 : board->length;
        printf("%" PRIu64 ".%06" PRIu64 " compass %.*s\n", t_us / 1000000, t_us % 1000000, (int)length, board->line);
        board->length = 0;
    } else if (board->length < sizeof board->line) {
        board->line[board->length++] = (char)value;
    }
}

/* What the event does to the board at once; the rest follows from the state. */
static void begin(board_t *board, const event_t *event)
{
    board->now = *event;
    board->clocks = 0;
    avr_raise_irq(board->sda, strcmp(event->state, "stuck") != 0);
    if (strcmp(event->state, "hang") == 0) {
        uint32_t free_word = board->avr->flashend - 1023; /* below the boot loader, which simavr does not have */
        board->avr->flash[free_word] = 0xFF;              /* rjmp to itself */
        board->avr->flash[free_word + 1] = 0xCF;
        board->avr->pc = free_word;
        strcpy(board->now.state, "ok"); /* the compass lives */
    }
}

static int read_scenario(event_t *events)
{
    char line[128];
    int count = 0;
    while (count < MAX_EVENTS && fgets(line, sizeof line, stdin) != NULL) {
        event_t *event = &events[count++];
        int read = sscanf(line, "%lf %15s %d %d %d", &event->t_s, event->state, &event->bearing_tenths,
                          &event->pitch_deg, &event->roll_deg);
        if (read != 2 && read != 5)
            return -1;
    }
    return count;
}

static void no_log(avr_t *avr, const int level, const char *format, va_list arguments)
{
    (void)avr;
    if (level <= LOG_ERROR)
        vfprintf(stderr, format, arguments);
}

int main(int argc, char **argv)
{
    static event_t events[MAX_EVENTS];
    static board_t board = {.now = {.state = "ok"}};
    elf_firmware_t firmware = {0};
    avr_global_logger_set(no_log);
    int count = argc == 2 ? read_scenario(events) : -1;
    if (count < 1 || strcmp(events[count - 1].state, "end") != 0) {
        fprintf(stderr, "simulated-board: usage: simulated-board compass.elf < SCENARIO, whose last line is T end\n");
        return 2;
    }
    if (elf_read_firmware(argv[1], &firmware) != 0 || (board.avr = avr_make_mcu_by_name("atmega328p")) == NULL) {
        fprintf(stderr, "simulated-board: cannot load %s\n", argv[1]);
        return 1;
    }
    avr_t *avr = board.avr;
    avr_init(avr);
    avr_load_firmware(avr, &firmware);
    avr->frequency = 16000000;
    uint32_t flags = 0; /* no echo on the simulator's own screen */
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    board.twi = avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), 0);
    board.sda = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('C'), SDA_PIN);
    for (int i = 0; i < avr->interrupts.vector_count; i++) {
        if (avr->interrupts.vector[i]->vector == TWI_VECTOR)
            board.vector = avr->interrupts.vector[i];
    }
    avr_irq_register_notify(board.twi + TWI_IRQ_OUTPUT, on_twi, &board);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('C'), IOPORT_IRQ_DIRECTION_ALL), on_directions,
                            &board);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_uart, &board);
    avr_raise_irq(board.sda, 1);

    printf("#tinyekf-recording 1\n#start 2026-01-01T00:00:00.000000Z\n");
    for (int next = 0; next < count;) {
        if ((double)avr->cycle / avr->frequency >= events[next].t_s)
            begin(&board, &events[next++]);
        int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed) {
            fprintf(stderr, "simulated-board: the program has ended\n");
            return 1;
        }
        if (strcmp(board.now.state, "stuck") == 0)
            avr_clear_interrupt(avr, board.vector); /* the bus never gets on */
    }
    return fflush(stdout) == 0 ? 0 : 1;
}
