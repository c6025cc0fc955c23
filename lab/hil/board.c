/* One FlightCtrl: an ATmega that runs the user's firmware cycle by cycle, and the parts soldered around it.

   Everything whose time base is a processor cycle is here: analog conversions, the I2C bus of the motor controllers,
   the receiver's pulses, the serial line. The physics is outside (aircraft.py): it sets the levels of `struct lines`,
   reads the motors' set points from it, and lets the processor run on, half a millisecond at a time.

   Linked with simavr (buserror/simavr, tag v1.6), whose sources the user brings; see build.py. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "avr_adc.h"
#include "avr_eeprom.h"
#include "avr_ioport.h"
#include "avr_spi.h"
#include "avr_twi.h"
#include "avr_uart.h"
#include "sim_avr.h"
#include "sim_cycle_timers.h"
#include "sim_elf.h"
#include "sim_io.h"

enum { ANALOG = 8, MOTORS = 12, CHANNELS = 16, QUEUE = 1 << 16 };

static const int MILLIVOLTS_PER_STEP = 5; /* supply and reference 5.115 V: 5 mV a step of the converter */
static const int SUPPLY_MV = 5115;
static const double FRAME_S = 0.0225, GAP_S = 0.0003; /* the receiver's pulse train; the pulse that parts two channels */
static const int NEUTRAL_TICKS = 466, TICK_CYCLES = 64; /* a channel at rest, and the firmware's unit of pulse length */
static const double DEAF_S = 0.022;     /* how often a receiver without transmitter is looked at */
static const double MOTOR_HOLD_S = 0.3; /* a motor controller stops so long after its last set point */
static const int FIRST_MOTOR = 0x52;    /* I2C address of the first controller */
static const int BAROMETER = 3;         /* its channel: the firmware shifts it with an analog output */
static const double BAROMETER_SHIFT = -52.0; /* steps of the converter a step of that output */

/* What crosses the board's edge; laid out as `Lines` of chip.py. */
struct lines {
    double analog[ANALOG]; /* level of every channel [LSB] */
    double noise[ANALOG];  /* standard deviation of one conversion [LSB] */
    double motor[MOTORS];  /* set point of every controller [count], fractions of 1/8 included */
    int32_t channel[CHANNELS]; /* receiver [count]; the first is number 1 */
    int32_t channels;      /* how many the transmitter sends */
    int32_t is_receiving;
    int32_t motors;        /* controllers on the bus */
    int32_t shift_address; /* of the output that shifts the barometer */
};

struct motor {
    uint8_t coarse, fine, mode;
    uint8_t config[8], written[16];
    int writes, reads;
    unsigned long frames;
    uint64_t at;
};

struct board {
    avr_t *avr;
    double end; /* where the last run was to end [cycle] */
    avr_uart_t *uart;
    struct lines lines;
    uint64_t random;
    /* to the board */
    avr_irq_t *serial_in;
    /* from it */
    uint8_t outbox[QUEUE];
    uint64_t out_at[QUEUE];
    unsigned out_head, out_tail;
    /* I2C */
    avr_irq_t *i2c_in;
    struct motor motor[MOTORS];
    int chosen, is_read;
    /* SPI */
    avr_irq_t *spi_in;
    uint8_t (*exchange)(double at, uint8_t value);
    /* receiver */
    avr_irq_t *capture;
    int pulse, is_high;
    avr_cycle_count_t used;
};

/* -- noise: xorshift, and a sum of twelve for a normal deviate -------------------------------------------------- */

static double uniform(struct board *b) {
    b->random ^= b->random << 13;
    b->random ^= b->random >> 7;
    b->random ^= b->random << 17;
    return (b->random >> 11) * (1.0 / 9007199254740992.0);
}

static double normal(struct board *b) {
    double sum = -6.0;
    for (int i = 0; i < 12; i++) sum += uniform(b);
    return sum;
}

/* -- serial line ------------------------------------------------------------------------------------------------ */

static void byte_written(struct avr_irq_t *irq, uint32_t value, void *param) {
    struct board *b = param;
    (void)irq;
    b->outbox[b->out_head % QUEUE] = value;
    b->out_at[b->out_head % QUEUE] = b->avr->cycle + b->uart->cycles_per_byte;
    b->out_head++;
}

/* A byte whose last bit arrives now. */
void board_receive(struct board *b, uint8_t value) { avr_raise_irq(b->serial_in, value); }

/* What left the board until now: bytes and the time of their last bit [s]; returns how many. */
int board_read(struct board *b, uint8_t *bytes, double *times, int most) {
    int count = 0;
    while (count < most && b->out_tail != b->out_head && b->out_at[b->out_tail % QUEUE] <= b->avr->cycle) {
        times[count] = b->out_at[b->out_tail % QUEUE] / (double)b->avr->frequency;
        bytes[count++] = b->outbox[b->out_tail++ % QUEUE];
    }
    return count;
}

/* -- motor controllers: BL-Ctrl, protocol 1 (one byte) and 2 (eleven bits, configuration) ------------------------- */

static uint8_t config_sum(const uint8_t *config) {
    uint8_t sum = 0xAA;
    for (int i = 0; i < 7; i++) sum += config[i];
    return sum;
}

static void set_config(struct motor *m, int is_default) {
    static const uint8_t DEFAULT[8] = {2, 0, 255, 30, 99, 64, 0, 0};
    if (is_default) memcpy(m->config, DEFAULT, 8);
    m->config[1] = 0;
    m->config[7] = config_sum(m->config);
}

static void motor_ends(struct board *b) {
    struct motor *m = &b->motor[b->chosen];
    if (!b->is_read && m->writes >= 2 + 8) {
        memcpy(m->config, m->written + 2, 8);
        set_config(m, m->written[3] & 0x40);
    }
    b->chosen = -1;
}

static void motor_written(struct board *b, uint8_t value) {
    struct motor *m = &b->motor[b->chosen];
    if (m->writes < 16) m->written[m->writes] = value;
    if (m->writes == 0) {
        m->coarse = value;
        m->fine = 0;
        m->frames++;
        m->at = b->avr->cycle;
    } else if (m->writes == 1) {
        m->fine = value & 7;
        m->mode = value >> 3;
    }
    m->writes++;
}

static uint8_t motor_read(struct motor *m) {
    int i = m->reads++;
    if (m->mode == 16) { /* asked for its configuration */
        if (i >= 7) m->mode = 0;
        return i < 8 ? m->config[i] : 0;
    }
    const uint8_t state[9] = {m->coarse / 6, m->coarse ? 255 : 250, 25, m->coarse, 0, 148, 0, 2, 8};
    return i < 9 ? state[i] : 0;
}

static void on_i2c(struct avr_irq_t *irq, uint32_t value, void *param) {
    struct board *b = param;
    avr_twi_msg_irq_t v;
    (void)irq;
    v.u.v = value;
    uint8_t message = v.u.twi.msg;
    if ((message & (TWI_COND_STOP | TWI_COND_START)) && b->chosen >= 0) motor_ends(b);
    if (message & TWI_COND_START) {
        int number = ((v.u.twi.addr & 0xfe) - FIRST_MOTOR) / 2;
        b->chosen = -1;
        if ((v.u.twi.addr & 0xfe) >= FIRST_MOTOR && number < b->lines.motors) {
            b->chosen = number;
            b->is_read = v.u.twi.addr & 1;
            b->motor[number].writes = b->motor[number].reads = 0;
            avr_raise_irq(b->i2c_in, avr_twi_irq_msg(TWI_COND_ACK, v.u.twi.addr, 1));
        }
    }
    if (b->chosen < 0) return;
    if (message & TWI_COND_WRITE) {
        avr_raise_irq(b->i2c_in, avr_twi_irq_msg(TWI_COND_ACK, v.u.twi.addr, 1));
        motor_written(b, v.u.twi.data);
    }
    if (message & TWI_COND_READ)
        avr_raise_irq(b->i2c_in, avr_twi_irq_msg(TWI_COND_READ, v.u.twi.addr, motor_read(&b->motor[b->chosen])));
}

static void update_motors(struct board *b) {
    for (int i = 0; i < MOTORS; i++) {
        struct motor *m = &b->motor[i];
        int is_old = !m->frames || b->avr->cycle - m->at > (uint64_t)(MOTOR_HOLD_S * b->avr->frequency);
        b->lines.motor[i] = is_old ? 0.0 : m->coarse + m->fine / 8.0;
    }
}

/* -- SPI: the firmware is master; without a NaviCtrl it reads zeros --------------------------------------------- */

static void on_spi(struct avr_irq_t *irq, uint32_t value, void *param) {
    struct board *b = param;
    (void)irq;
    if (b->exchange) avr_raise_irq(b->spi_in, b->exchange(b->avr->cycle / (double)b->avr->frequency, value));
}

/* Connect a board that answers each byte, whose last bit crosses at a time [s], with one of its own. */
void board_connect(struct board *b, uint8_t (*exchange)(double at, uint8_t value)) { b->exchange = exchange; }

/* -- analog channels: sampled when a conversion begins ------------------------------------------------------------ */

static void on_conversion(struct avr_irq_t *irq, uint32_t value, void *param) {
    struct board *b = param;
    union {
        avr_adc_mux_t mux;
        uint32_t v;
    } e = {.v = value};
    int channel = e.mux.src;
    (void)irq;
    if (channel < 0 || channel >= ANALOG) return;
    double level = b->lines.analog[channel] + b->lines.noise[channel] * normal(b);
    if (channel == BAROMETER) level += BAROMETER_SHIFT * b->avr->data[b->lines.shift_address];
    int steps = (int)floor(level + 0.5);
    steps = steps < 0 ? 0 : steps > 1023 ? 1023 : steps;
    avr_irq_t *pin = avr_io_getirq(b->avr, AVR_IOCTL_ADC_GETIRQ, 0) + channel;
    avr_raise_irq(pin, steps * MILLIVOLTS_PER_STEP + MILLIVOLTS_PER_STEP / 2);
}

/* -- receiver: one pulse train on the input capture --------------------------------------------------------------- */

static avr_cycle_count_t next_pulse(avr_t *avr, avr_cycle_count_t when, void *param) {
    struct board *b = param;
    avr_cycle_count_t gap = (avr_cycle_count_t)(GAP_S * avr->frequency), width;
    if (!b->lines.is_receiving) {
        avr_raise_irq(b->capture, 0);
        b->pulse = b->is_high = 0;
        b->used = 0;
        return when + (avr_cycle_count_t)(DEAF_S * avr->frequency);
    }
    if (!b->is_high) {
        avr_raise_irq(b->capture, 1);
        b->is_high = 1;
        return when + gap;
    }
    avr_raise_irq(b->capture, 0);
    b->is_high = 0;
    if (b->pulse < b->lines.channels) {
        width = (avr_cycle_count_t)(NEUTRAL_TICKS + b->lines.channel[b->pulse++]) * TICK_CYCLES;
        b->used += width;
    } else {
        width = (avr_cycle_count_t)(FRAME_S * avr->frequency) - b->used;
        b->used = 0;
        b->pulse = 0;
    }
    return when + width - gap;
}

/* -- life --------------------------------------------------------------------------------------------------------- */

static void tie_pin(struct board *b, char port, int pin, int level) {
    avr_ioport_external_t e = {.name = port, .mask = 1 << pin, .value = level << pin};
    avr_ioctl(b->avr, AVR_IOCTL_IOPORT_SET_EXTERNAL(port), &e);
    avr_raise_irq(avr_io_getirq(b->avr, AVR_IOCTL_IOPORT_GETIRQ(port), pin), level);
}

/* Levels that the board's resistors and a transmitter at rest give: with others the firmware looks for a boot loader. */
static void power_up(struct board *b) {
    uint32_t none = 0;
    avr_ioctl(b->avr, AVR_IOCTL_UART_SET_FLAGS('0'), &none);
    avr_ioctl(b->avr, AVR_IOCTL_UART_SET_FLAGS('1'), &none);
    avr_raise_irq(b->capture, 0);
    tie_pin(b, 'D', 4, 0);
    tie_pin(b, 'B', 1, 1);
    tie_pin(b, 'C', 4, 1);
    b->pulse = b->is_high = 0;
    b->used = 0;
    avr_cycle_timer_register(b->avr, b->avr->frequency / 100, next_pulse, b);
}

struct board *board_new(const char *elf, const char *mcu, uint32_t frequency, uint8_t *eeprom, int size, uint64_t seed) {
    elf_firmware_t firmware = {{0}};
    struct board *b = calloc(1, sizeof *b);
    b->random = 88172645463325252ULL ^ seed * 2654435761ULL;
    for (int i = 0; i < 20; i++) uniform(b);
    b->chosen = -1;
    if (elf_read_firmware(elf, &firmware)) return NULL;
    firmware.frequency = frequency;
    strcpy(firmware.mmcu, mcu);
    firmware.vcc = firmware.avcc = firmware.aref = SUPPLY_MV;
    b->avr = avr_make_mcu_by_name(mcu);
    if (!b->avr) return NULL;
    avr_init(b->avr);
    b->avr->log = LOG_ERROR;
    avr_load_firmware(b->avr, &firmware);
    b->avr->frequency = frequency;
    b->avr->vcc = b->avr->avcc = b->avr->aref = SUPPLY_MV;
    for (avr_io_t *io = b->avr->io_port; io; io = io->next)
        if (!strcmp(io->kind, "uart") && ((avr_uart_t *)io)->name == '0') b->uart = (void *)io;
    avr_eeprom_desc_t content = {.ee = eeprom, .offset = 0, .size = size};
    avr_ioctl(b->avr, AVR_IOCTL_EEPROM_SET, &content);
    for (int i = 0; i < MOTORS; i++) set_config(&b->motor[i], 1);
    avr_t *avr = b->avr;
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), byte_written, b);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_OUTPUT), on_i2c, b);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_OUT_TRIGGER), on_conversion, b);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_SPI_GETIRQ(0), SPI_IRQ_OUTPUT), on_spi, b);
    b->spi_in = avr_io_getirq(avr, AVR_IOCTL_SPI_GETIRQ(0), SPI_IRQ_INPUT);
    b->i2c_in = avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_INPUT);
    b->serial_in = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    b->capture = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('D'), 6);
    power_up(b);
    return b;
}

struct lines *board_lines(struct board *b) { return &b->lines; }

/* A brown-out: the processor starts anew; transmitter, line and motor controllers go on. */
void board_reset(struct board *b) {
    avr_reset(b->avr);
    power_up(b);
}

/* Run on for so many seconds; 0, or simavr's state when the processor stopped. */
int board_run(struct board *b, double seconds) {
    avr_t *avr = b->avr;
    /* Instructions overshoot the end by some cycles: the next run begins where this one was to end, so that the
       processor's clock stays with the world's. */
    b->end += seconds * avr->frequency;
    while (avr->cycle < b->end) {
        int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed) return state;
    }
    /* simavr 1.6 counts two stop bits where the firmware asks for one */
    if (b->uart->cycles_per_byte % 11 == 0) b->uart->cycles_per_byte = b->uart->cycles_per_byte / 11 * 10;
    update_motors(b);
    return 0;
}

double board_time(struct board *b) { return b->avr->cycle / (double)b->avr->frequency; }

void board_peek(struct board *b, int address, uint8_t *bytes, int count) {
    memcpy(bytes, b->avr->data + address, count);
}

void board_poke(struct board *b, int address, const uint8_t *bytes, int count) {
    memcpy(b->avr->data + address, bytes, count);
}

void board_eeprom(struct board *b, uint8_t *bytes, int size) {
    avr_eeprom_desc_t content = {.ee = bytes, .offset = 0, .size = size};
    avr_ioctl(b->avr, AVR_IOCTL_EEPROM_GET, &content);
}
