/* One NaviCtrl: the user's firmware, compiled for this machine, and the parts soldered around its STR91x.

   The firmware asks for its hardware through the functions of the processor's library, which stand here in their place;
   the few registers it touches itself lie in memory at the addresses of the processor. Its main loop is a coroutine: the
   compiler calls `__sanitizer_cov_trace_pc` in every basic block, where time goes on, interrupts come, and the loop stops
   when it has run as long as it was told to. So a firmware that waits in a loop waits in virtual time.

   Compiled with the user's own headers of the firmware and of that library; see build.py. */
#define _GNU_SOURCE
#include <math.h>
#include <signal.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <ucontext.h>

#include "91x_lib.h"

enum { UARTS = 3, FIFO = 16, SPI_FIFO = 8, SPI_LEVEL = 4, LINES = 32, TIMERS = 2, QUEUE = 1 << 16, MAIN_LOOP = 64 };

static const uint64_t NEVER = UINT64_MAX;
static const uint64_t BLOCK_NS = 250;           /* a basic block: twelve cycles, an estimate; the idle main loop takes 26 us */
static const uint64_t SECOND_NS = 1000000000;
static const uint64_t CONVERSION_NS = 1100000;  /* seven analog channels at 94 kHz */
static const uint64_t SPI_TIMEOUT_NS = 102400;  /* 32 bits of a bus at 312.5 kHz */
static const uint32_t PCLK_KHZ = 24000;
static const int BITS = 10, TIMEOUT_BITS = 32;  /* of a character; of silence after which a UART hands over */
static const size_t STACK = 1 << 20;
static const uint16_t NOT_WRITTEN = 0xFFFF;     /* a data register that the firmware left alone */

/* What crosses the board's edge; laid out as `NaviLines` of navigation.py. */
struct lines {
    int16_t field[3];  /* magnetic, as the compass board says it [count] */
    int16_t has_compass;
};

struct uart {
    uint64_t bit_ns;
    int is_on, level;
    uint16_t enabled;
    uint8_t fifo[FIFO];
    int held;
    uint64_t last_at;
    uint64_t free_at;                       /* when the last character written will have left */
    uint8_t out[QUEUE];
    uint64_t out_at[QUEUE];
    unsigned head, tail;
};

struct timer {
    TIM_TypeDef *registers;
    uint64_t tick_ns, began, due[2];
    uint16_t enabled, flags;
    int runs;
};

struct i2c {
    uint64_t due;
    uint16_t next, event;                   /* that will come, and that the firmware has not read yet */
    int is_stopped, is_reading, address, has_read;
    uint8_t command[16], answer[16];
    int commands, answers, position;
};

static struct {
    uint64_t now, until, wake;
    ucontext_t outside, inside;
    int is_running, priority, may_nest;
    uint8_t line_enabled[LINES], line_priority[LINES], line_soft[LINES];
    struct uart uart[UARTS];
    struct timer timer[TIMERS];
    struct i2c i2c;
    struct lines lines;
    uint8_t spi_in[SPI_FIFO], spi_out[SPI_FIFO];
    int spi_held, spi_waiting, is_writing_spi;
    uint64_t spi_last;
    uint16_t spi_enabled;
    uint64_t converted;
    int has_converted, is_in_loader, has_gps_pin, has_compass_pin;
} board;

int firmware_main(void);

/* -- interrupts --------------------------------------------------------------------------------------------------- */

#define HANDLER(name) extern void name(void) __attribute__((weak))
HANDLER(TIM1_IRQHandler);
HANDLER(TIM2_IRQHandler);
HANDLER(ADC_IRQHandler);
HANDLER(UART0_IRQHandler);
HANDLER(UART1_IRQHandler);
HANDLER(UART2_IRQHandler);
HANDLER(I2C1_IRQHandler);
HANDLER(SSP0_IRQHandler);
HANDLER(EXTIT3_IRQHandler);

static void (*handler_of(int line))(void) {
    switch (line) {
    case TIM1_ITLine: return TIM1_IRQHandler;
    case TIM2_ITLine: return TIM2_IRQHandler;
    case ADC_ITLine: return ADC_IRQHandler;
    case UART0_ITLine: return UART0_IRQHandler;
    case UART1_ITLine: return UART1_IRQHandler;
    case UART2_ITLine: return UART2_IRQHandler;
    case I2C1_ITLine: return I2C1_IRQHandler;
    case SSP0_ITLine: return SSP0_IRQHandler;
    case EXTIT3_ITLine: return EXTIT3_IRQHandler;
    default: return NULL;
    }
}

static uint16_t uart_raised(const struct uart *u) {
    uint16_t raised = 0;
    if (u->held >= u->level) raised |= UART_IT_Receive;
    if (u->held && board.now >= u->last_at + TIMEOUT_BITS * u->bit_ns) raised |= UART_IT_ReceiveTimeOut;
    return raised & u->enabled;
}

static uint16_t spi_raised(void) {
    uint16_t raised = 0;
    if (board.spi_held >= SPI_LEVEL) raised |= SSP_IT_RxFifo;
    if (board.spi_held && board.now >= board.spi_last + SPI_TIMEOUT_NS) raised |= SSP_IT_RxTimeOut;
    return raised & board.spi_enabled;
}

static int is_raised(int line) {
    if (board.line_soft[line]) return 1;
    switch (line) {
    case TIM1_ITLine: return (board.timer[0].flags & board.timer[0].enabled) != 0;
    case TIM2_ITLine: return (board.timer[1].flags & board.timer[1].enabled) != 0;
    case ADC_ITLine: return board.has_converted;
    case UART0_ITLine: return uart_raised(&board.uart[0]) != 0;
    case UART1_ITLine: return uart_raised(&board.uart[1]) != 0;
    case UART2_ITLine: return uart_raised(&board.uart[2]) != 0;
    case I2C1_ITLine: return board.i2c.event != 0;
    case SSP0_ITLine: return spi_raised() != 0;
    default: return 0;
    }
}

/* Of two lines the one with the smaller number goes first: the first controller has the lower half of the lines. */
static int priority_of(int line) { return (line < LINES / 2 ? 0 : 16) + board.line_priority[line]; }

static void compare_times(struct timer *t);

/* Something has changed that may raise an interrupt: look at the next basic block. */
static void touched(void) { board.wake = 0; }

static void interrupt(void) {
    int best = -1;
    for (int line = 0; line < LINES; line++) {
        if (!board.line_enabled[line] || !handler_of(line) || !is_raised(line)) continue;
        if (priority_of(line) >= board.priority) continue;
        if (best < 0 || priority_of(line) < priority_of(best)) best = line;
    }
    if (best < 0) return;
    int before = board.priority;
    board.priority = priority_of(best);
    board.may_nest = 0;
    handler_of(best)();
    board.priority = before;
    board.may_nest = 1;
    for (int i = 0; i < TIMERS; i++) compare_times(&board.timer[i]);
    touched();
}

/* In place of the assembly with which a handler lets others interrupt it, and stops that again. A fork has it in a
   function of its main loop too, where it means nothing. */
void board_assembly(const char *text) {
    if (board.priority == MAIN_LOOP) return;
    if (strstr(text, "#0x1F")) board.may_nest = 1, touched();
    if (strstr(text, "#0x92")) board.may_nest = 0;
}

/* -- time --------------------------------------------------------------------------------------------------------- */

static void i2c_happens(void);

static void first(uint64_t *wake, uint64_t at) {
    if (at < *wake && at > board.now) *wake = at;
}

/* What the hardware does by itself until now, and when it does something next. */
static void happen(void) {
    uint64_t wake = NEVER;
    for (int i = 0; i < TIMERS; i++) {
        struct timer *t = &board.timer[i];
        for (int k = 0; k < 2 && t->runs; k++) {
            if (board.now >= t->due[k]) {
                t->flags |= k ? TIM_FLAG_OC2 : TIM_FLAG_OC1;
                t->due[k] += 65536 * t->tick_ns;
            }
            first(&wake, t->due[k]);
        }
    }
    if (board.now >= board.converted) {
        board.has_converted = 1;
        board.converted = NEVER;
    }
    if (board.now >= board.i2c.due) i2c_happens();
    for (int i = 0; i < UARTS; i++)
        if (board.uart[i].held) first(&wake, board.uart[i].last_at + TIMEOUT_BITS * board.uart[i].bit_ns);
    if (board.spi_held) first(&wake, board.spi_last + SPI_TIMEOUT_NS);
    first(&wake, board.converted);
    first(&wake, board.i2c.due);
    board.wake = wake;
}

void __sanitizer_cov_trace_pc(void) {
    board.now += BLOCK_NS;
    if (board.now >= board.wake) {
        happen();
        if (board.may_nest) interrupt();
    }
    if (board.now >= board.until) swapcontext(&board.inside, &board.outside);
}

/* -- VIC ---------------------------------------------------------------------------------------------------------- */

void VIC_DeInit(void) {
    memset(board.line_enabled, 0, sizeof board.line_enabled);
    memset(board.line_soft, 0, sizeof board.line_soft);
}

void VIC_InitDefaultVectors(void) {}

void VIC_Config(u16 line, VIC_ITLineMode mode, u8 priority) {
    (void)mode;
    board.line_priority[line] = priority;
}

void VIC_ITCmd(u16 line, FunctionalState state) {
    if (line < LINES) board.line_enabled[line] = state != DISABLE;
    touched();
}

void VIC_SWITCmd(u16 line, FunctionalState state) {
    board.line_soft[line] = state != DISABLE;
    touched();
}

/* -- UARTs -------------------------------------------------------------------------------------------------------- */

static struct uart *uart_of(UART_TypeDef *u) { return &board.uart[u == UART0 ? 0 : u == UART1 ? 1 : 2]; }

void UART_DeInit(UART_TypeDef *which) {
    struct uart *u = uart_of(which);
    u->held = u->is_on = u->enabled = 0;
    while (u->tail != u->head && u->out_at[(u->head - 1) % QUEUE] > board.now + BITS * u->bit_ns) u->head--;
    u->free_at = board.now;
}

void UART_StructInit(UART_InitTypeDef *init) { memset(init, 0, sizeof *init); }

void UART_Init(UART_TypeDef *which, UART_InitTypeDef *init) {
    static const int LEVELS[] = {2, 4, 8, 12, 14};
    struct uart *u = uart_of(which);
    u->bit_ns = SECOND_NS / init->UART_BaudRate;
    u->level = LEVELS[init->UART_RxFIFOLevel];
}

void UART_Cmd(UART_TypeDef *which, FunctionalState state) { uart_of(which)->is_on = state != DISABLE; }

void UART_ITConfig(UART_TypeDef *which, u16 mask, FunctionalState state) {
    struct uart *u = uart_of(which);
    u->enabled = state != DISABLE ? u->enabled | mask : u->enabled & ~mask;
}

FlagStatus UART_GetFlagStatus(UART_TypeDef *which, u16 flag) {
    struct uart *u = uart_of(which);
    __sanitizer_cov_trace_pc();
    /* one character is being shifted out, the others wait */
    uint64_t left = u->free_at > board.now ? (u->free_at - board.now + BITS * u->bit_ns - 1) / (BITS * u->bit_ns) : 0;
    switch (flag) {
    case UART_FLAG_RxFIFOEmpty: return u->held ? RESET : SET;
    case UART_FLAG_RxFIFOFull: return u->held == FIFO ? SET : RESET;
    case UART_FLAG_TxFIFOFull: return left > FIFO ? SET : RESET;
    case UART_FLAG_TxFIFOEmpty: return left > 1 ? RESET : SET;
    default: return RESET;
    }
}

ITStatus UART_GetITStatus(UART_TypeDef *which, u16 flag) { return uart_raised(uart_of(which)) & flag ? SET : RESET; }

void UART_ClearITPendingBit(UART_TypeDef *which, u16 flag) {
    (void)which, (void)flag; /* both go by themselves with the characters */
}

void UART_SendData(UART_TypeDef *which, u8 value) {
    struct uart *u = uart_of(which);
    if (!u->is_on) return;
    if (u->free_at < board.now) u->free_at = board.now;
    u->free_at += BITS * u->bit_ns;
    u->out[u->head % QUEUE] = value;
    u->out_at[u->head++ % QUEUE] = u->free_at;
}

u8 UART_ReceiveData(UART_TypeDef *which) {
    struct uart *u = uart_of(which);
    u8 value = u->fifo[0];
    if (u->held) memmove(u->fifo, u->fifo + 1, --u->held);
    touched();
    return value;
}

/* -- timers ------------------------------------------------------------------------------------------------------- */

static struct timer *timer_of(TIM_TypeDef *which) { return &board.timer[which == TIM1 ? 0 : 1]; }

/* When the counter next meets what the firmware has written into the compare registers. */
static void compare_times(struct timer *t) {
    if (!t->runs) return;
    uint64_t count = (board.now - t->began) / t->tick_ns;
    const uint16_t compare[2] = {t->registers->OC1R, t->registers->OC2R};
    for (int k = 0; k < 2; k++) {
        uint64_t ahead = (uint16_t)(compare[k] - count);
        t->due[k] = t->began + (count + (ahead ? ahead : 65536)) * t->tick_ns;
    }
    touched();
}

void TIM_DeInit(TIM_TypeDef *which) {
    struct timer *t = timer_of(which);
    t->runs = t->enabled = t->flags = 0;
    memset((void *)which, 0, sizeof *which);
}

void TIM_StructInit(TIM_InitTypeDef *init) { memset(init, 0, sizeof *init); }

void TIM_Init(TIM_TypeDef *which, TIM_InitTypeDef *init) {
    struct timer *t = timer_of(which);
    t->registers = which;
    t->tick_ns = 1000000ull * init->TIM_Prescaler / PCLK_KHZ;
}

void TIM_ITConfig(TIM_TypeDef *which, u16 mask, FunctionalState state) {
    struct timer *t = timer_of(which);
    uint16_t flags = (mask & TIM_IT_OC1 ? TIM_FLAG_OC1 : 0) | (mask & TIM_IT_OC2 ? TIM_FLAG_OC2 : 0);
    t->enabled = state != DISABLE ? t->enabled | flags : t->enabled & ~flags;
}

void TIM_CounterCmd(TIM_TypeDef *which, TIM_CounterOperations what) {
    struct timer *t = timer_of(which);
    if (what == TIM_STOP) t->runs = 0;
    if (what != TIM_START) t->began = board.now;
    if (what == TIM_START) {
        t->runs = 1;
        t->began = board.now;
    }
    compare_times(t);
}

FlagStatus TIM_GetFlagStatus(TIM_TypeDef *which, u16 flag) { return timer_of(which)->flags & flag ? SET : RESET; }

void TIM_ClearFlag(TIM_TypeDef *which, u16 flag) { timer_of(which)->flags &= ~flag; }

/* -- I2C: the compass board, nothing else answers ----------------------------------------------------------------- */

enum { COMPASS = 0x50, ASKS_VERSION = 1, ASKS_FIELD = 2, WRITES_STATE = 4 };
static const uint8_t COMPASS_VERSION[4] = {0, 23, 0, 3}; /* release, and the protocol both must agree on */
static const uint64_t I2C_BIT_NS = 20000;                /* 50 kHz */

static void i2c_will(uint16_t event, int bits) {
    board.i2c.next = event;
    board.i2c.due = board.now + bits * I2C_BIT_NS;
    touched();
}

static void i2c_happens(void) {
    board.i2c.due = NEVER;
    board.i2c.event = board.i2c.next;
}

/* What the compass board has ready after a command: the data, and their inverted sum. */
static void compass_answers(void) {
    struct i2c *bus = &board.i2c;
    uint8_t sum = 0;
    bus->answers = bus->position = 0;
    if (!bus->commands) return;
    if (bus->command[0] == ASKS_VERSION) memcpy(bus->answer, COMPASS_VERSION, bus->answers = 4);
    if (bus->command[0] == ASKS_FIELD) memcpy(bus->answer, board.lines.field, bus->answers = 6);
    if (bus->command[0] == WRITES_STATE) memcpy(bus->answer, bus->command + 1, bus->answers = 3);
    for (int i = 0; i < bus->answers; i++) sum += bus->answer[i];
    bus->answer[bus->answers++] = ~sum;
}

void I2C_DeInit(I2C_TypeDef *which) {
    (void)which;
    board.i2c.due = NEVER;
    board.i2c.event = 0;
}

void I2C_StructInit(I2C_InitTypeDef *init) { memset(init, 0, sizeof *init); }
void I2C_Init(I2C_TypeDef *which, I2C_InitTypeDef *init) { (void)which, (void)init; }
void I2C_ITConfig(I2C_TypeDef *which, FunctionalState state) { (void)which, (void)state; }
void I2C_AcknowledgeConfig(I2C_TypeDef *which, FunctionalState state) { (void)which, (void)state; }
ErrorStatus I2C_CheckEvent(I2C_TypeDef *which, u16 event) { return (void)which, (void)event, SUCCESS; }
FlagStatus I2C_GetFlagStatus(I2C_TypeDef *which, u16 flag) { return (void)which, (void)flag, RESET; }

/* A byte is read as soon as the address has been answered. */
void I2C_Cmd(I2C_TypeDef *which, FunctionalState state) {
    (void)which;
    if (state != DISABLE && board.i2c.is_reading && !board.i2c.has_read) {
        board.i2c.has_read = 1;
        i2c_will(I2C_EVENT_MASTER_BYTE_RECEIVED, 9);
    }
}

void I2C_GenerateStart(I2C_TypeDef *which, FunctionalState state) {
    (void)which;
    board.i2c.is_stopped = state == DISABLE;
    board.i2c.is_reading = 0;
    if (state != DISABLE) i2c_will(I2C_EVENT_MASTER_MODE_SELECT, 1);
}

void I2C_GenerateSTOP(I2C_TypeDef *which, FunctionalState state) {
    (void)which;
    if (state == DISABLE) return;
    board.i2c.is_stopped = 1;
    board.i2c.is_reading = 0;
    board.i2c.due = NEVER;
}

void I2C_Send7bitAddress(I2C_TypeDef *which, u8 address, u8 direction) {
    struct i2c *bus = &board.i2c;
    int is_there = address == COMPASS && board.lines.has_compass;
    (void)which;
    bus->is_reading = is_there && direction == I2C_MODE_RECEIVER;
    bus->has_read = 0;
    if (direction == I2C_MODE_TRANSMITTER) bus->commands = 0;
    if (bus->is_reading) compass_answers();
    i2c_will(is_there ? I2C_EVENT_MASTER_MODE_SELECTED : I2C_FLAG_AF, 9);
}

void I2C_SendData(I2C_TypeDef *which, u8 value) {
    struct i2c *bus = &board.i2c;
    (void)which;
    if (bus->commands < (int)sizeof bus->command) bus->command[bus->commands++] = value;
    i2c_will(I2C_EVENT_MASTER_BYTE_TRANSMITTED, 9);
}

u8 I2C_ReceiveData(I2C_TypeDef *which) {
    struct i2c *bus = &board.i2c;
    (void)which;
    u8 value = bus->position < bus->answers ? bus->answer[bus->position++] : 0xFF;
    if (!bus->is_stopped) i2c_will(I2C_EVENT_MASTER_BYTE_RECEIVED, 9);
    return value;
}

u16 I2C_GetLastEvent(I2C_TypeDef *which) {
    u16 event = board.i2c.event;
    (void)which;
    board.i2c.event = 0;
    return event;
}

/* -- SPI: the FlightCtrl is master of the first; the second has no card at its other end --------------------------- */

/* The firmware writes the data register itself; what it wrote is found there when it next asks for something. */
static void collect_spi(void) {
    if (board.is_writing_spi && SSP0->DR != NOT_WRITTEN && board.spi_waiting < SPI_FIFO)
        board.spi_out[board.spi_waiting++] = SSP0->DR;
    board.is_writing_spi = 0;
}

FlagStatus SSP_GetFlagStatus(SSP_TypeDef *which, u16 flag) {
    if (which != SSP0) return flag == SSP_FLAG_RxFifoNotEmpty ? RESET : SET;
    collect_spi();
    if (flag == SSP_FLAG_TxFifoNotFull) {
        board.is_writing_spi = board.spi_waiting < SPI_FIFO;
        if (board.is_writing_spi) SSP0->DR = NOT_WRITTEN;
        return board.is_writing_spi ? SET : RESET;
    }
    if (flag != SSP_FLAG_RxFifoNotEmpty || !board.spi_held) return RESET;
    SSP0->DR = board.spi_in[0];
    memmove(board.spi_in, board.spi_in + 1, --board.spi_held);
    return SET;
}

void SSP_DeInit(SSP_TypeDef *which) {
    if (which == SSP0) board.spi_held = board.spi_waiting = board.is_writing_spi = board.spi_enabled = 0;
}

void SSP_StructInit(SSP_InitTypeDef *init) { memset(init, 0, sizeof *init); }
void SSP_Init(SSP_TypeDef *which, SSP_InitTypeDef *init) { (void)which, (void)init; }
void SSP_Cmd(SSP_TypeDef *which, FunctionalState state) { (void)which, (void)state; }
void SSP_ClearITPendingBit(SSP_TypeDef *which, u16 flag) { (void)which, (void)flag; }
void SSP_SendData(SSP_TypeDef *which, u16 value) { (void)which, (void)value; }
u16 SSP_ReceiveData(SSP_TypeDef *which) { return (void)which, 0xFF; }

void SSP_ITConfig(SSP_TypeDef *which, u16 mask, FunctionalState state) {
    if (which == SSP0) board.spi_enabled = state != DISABLE ? board.spi_enabled | mask : board.spi_enabled & ~mask;
}

/* -- pins, converter, clocks, wake-up lines, USB ------------------------------------------------------------------- */

/* The one UART that two parts share belongs to the one whose pin is connected. */
void GPIO_Init(GPIO_TypeDef *port, GPIO_InitTypeDef *init) {
    int is_connected = init->GPIO_IPInputConnected == GPIO_IPInputConnected_Enable;
    if (port == GPIO6 && init->GPIO_Pin == GPIO_Pin_6) board.has_gps_pin = is_connected;
    if (port == GPIO5 && init->GPIO_Pin == GPIO_Pin_1) board.has_compass_pin = is_connected;
}

void GPIO_DeInit(GPIO_TypeDef *port) { (void)port; }
void GPIO_StructInit(GPIO_InitTypeDef *init) { memset(init, 0, sizeof *init); }
void GPIO_WriteBit(GPIO_TypeDef *port, u8 pin, BitAction level) { (void)port, (void)pin, (void)level; }
void GPIO_ANAPinConfig(u8 channel, FunctionalState state) { (void)channel, (void)state; }
/* Both lights pull down, as on hardware 1.1; the switch of the card's slot is open. */
u8 GPIO_Read(GPIO_TypeDef *port) { return port == GPIO5 ? GPIO_Pin_3 : 0; }
u8 GPIO_ReadBit(GPIO_TypeDef *port, u8 pin) { return GPIO_Read(port) & pin ? Bit_SET : Bit_RESET; }

void ADC_DeInit(void) { board.converted = NEVER; }
void ADC_Init(ADC_InitTypeDef *init) { (void)init; }
void ADC_StructInit(ADC_InitTypeDef *init) { memset(init, 0, sizeof *init); }
void ADC_PrescalerConfig(u8 value) { (void)value; }
void ADC_ITConfig(u16 mask, FunctionalState state) { (void)mask, (void)state; }
void ADC_StandbyModeCmd(FunctionalState state) { (void)state; }
void ADC_Cmd(FunctionalState state) { (void)state; }
void ADC_ClearFlag(u16 flag) { (void)flag, board.has_converted = 0; }
FlagStatus ADC_GetFlagStatus(u16 flag) { return (void)flag, board.has_converted ? SET : RESET; }
u16 ADC_GetConversionValue(u16 channel) { return (void)channel, 512; }

void ADC_ConversionCmd(u16 what) {
    board.converted = what == ADC_Conversion_Start ? board.now + CONVERSION_NS : NEVER;
    touched();
}

ErrorStatus SCU_MCLKSourceConfig(u32 value) { return (void)value, SUCCESS; }
ErrorStatus SCU_PLLFactorsConfig(u8 n, u8 m, u8 p) { return (void)n, (void)m, (void)p, SUCCESS; }
ErrorStatus SCU_PLLCmd(FunctionalState state) { return (void)state, SUCCESS; }
void SCU_RCLKDivisorConfig(u32 value) { (void)value; }
void SCU_HCLKDivisorConfig(u32 value) { (void)value; }
void SCU_PCLKDivisorConfig(u32 value) { (void)value; }
void SCU_BRCLKDivisorConfig(u32 value) { (void)value; }
void SCU_USBCLKConfig(u32 value) { (void)value; }
void SCU_APBPeriphClockConfig(u32 part, FunctionalState state) { (void)part, (void)state; }
void SCU_AHBPeriphClockConfig(u32 part, FunctionalState state) { (void)part, (void)state; }
void SCU_APBPeriphReset(u32 part, FunctionalState state) { (void)part, (void)state; }
void SCU_AHBPeriphReset(u32 part, FunctionalState state) { (void)part, (void)state; }
void SCU_WakeUpLineConfig(u8 line) { (void)line; }
u32 SCU_GetPCLKFreqValue(void) { return PCLK_KHZ; }
void WIU_Init(WIU_InitTypeDef *init) { (void)init; }
void WIU_Cmd(FunctionalState state) { (void)state; }
void WIU_ClearITPendingBit(u32 line) { (void)line; }

/* Nobody plugs a cable into the USB socket. */
int bDeviceState, Device_Info[4];
void USB_Init(void) {}
void SetEPTxCount(u8 end, u16 count) { (void)end, (void)count; }
void SetEPTxValid(u8 end) { (void)end; }
void UserToPMABufferCopy(u8 *from, u16 to, u16 count) { (void)from, (void)to, (void)count; }
void PowerOff(void) {}

/* The boot loader says nothing to anybody, until the power is switched off. */
void Execute_Bootloader(void) {
    board.is_in_loader = 1;
    for (;;) __sanitizer_cov_trace_pc();
}

/* -- life --------------------------------------------------------------------------------------------------------- */

/* A division by zero gives zero, as on that processor, which divides in software; here it stops the process. */
static void divided_by_zero(int number, siginfo_t *info, void *context) {
    greg_t *r = ((ucontext_t *)context)->uc_mcontext.gregs;
    const uint8_t *code = (const uint8_t *)r[REG_RIP];
    (void)number, (void)info;
    while (*code == 0x66 || (*code & 0xF0) == 0x40) code++;
    if (*code != 0xF7 && *code != 0xF6) abort();
    uint8_t mode = code[1] >> 6, base = code[1] & 7;
    code += 2;
    if (mode != 3 && base == 4) base = *code++ & 7;
    if (mode == 1) code += 1;
    if (mode == 2 || (mode == 0 && base == 5)) code += 4;
    r[REG_RIP] = (greg_t)code;
    r[REG_RAX] = r[REG_RDX] = 0;
}

static void live(void) {
    firmware_main();
    abort(); /* its main loop never ends */
}

static int has_registers(uintptr_t at) {
    void *page = mmap((void *)(at & ~4095ul), 4096, PROT_READ | PROT_WRITE,
                      MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED_NOREPLACE, -1, 0);
    return page == (void *)(at & ~4095ul);
}

/* Power it up; 0, or 1 where the registers' addresses are in use, as after the first. */
int navi_new(void) {
    struct sigaction action = {.sa_sigaction = divided_by_zero, .sa_flags = SA_SIGINFO};
    if (!has_registers((uintptr_t)TIM1) || !has_registers((uintptr_t)TIM2) || !has_registers((uintptr_t)SSP0)) return 1;
    sigaction(SIGFPE, &action, NULL);
    memset(&board, 0, sizeof board);
    board.priority = MAIN_LOOP;
    board.may_nest = 1;
    board.converted = board.i2c.due = NEVER;
    board.timer[0].registers = TIM1;
    board.timer[1].registers = TIM2;
    for (int i = 0; i < UARTS; i++) board.uart[i].bit_ns = SECOND_NS / 57600;
    getcontext(&board.inside);
    board.inside.uc_stack.ss_sp = malloc(STACK);
    board.inside.uc_stack.ss_size = STACK;
    makecontext(&board.inside, live, 0);
    return 0;
}

struct lines *navi_lines(void) { return &board.lines; }

double navi_time(void) { return board.now / (double)SECOND_NS; }

/* Run on until a time [s]; a basic block that has begun is finished. */
void navi_run(double until) {
    board.until = (uint64_t)llround(until * SECOND_NS);
    touched();
    if (board.now < board.until) swapcontext(&board.outside, &board.inside);
}

/* A character whose last bit arrives now, at the first UART from the GPS receiver (1) or the compass board (0). */
void navi_receive(int number, int is_gps, uint8_t value) {
    struct uart *u = &board.uart[number];
    if (number == 0 && !(is_gps ? board.has_gps_pin : board.has_compass_pin)) return;
    if (!u->is_on || u->held == FIFO) return;
    u->fifo[u->held++] = value;
    u->last_at = board.now;
    touched();
}

/* What left a UART until now: characters, and the times of their last bits [s]; returns how many. */
int navi_read(int number, uint8_t *bytes, double *times, int most) {
    struct uart *u = &board.uart[number];
    int count = 0;
    while (count < most && u->tail != u->head && u->out_at[u->tail % QUEUE] <= board.now) {
        times[count] = u->out_at[u->tail % QUEUE] / (double)SECOND_NS;
        bytes[count++] = u->out[u->tail++ % QUEUE];
    }
    return count;
}

/* One byte each way on the bus to the FlightCtrl, whose last bits cross it at a time [s]. */
uint8_t navi_exchange(double at, uint8_t value) {
    uint8_t said = 0;
    navi_run(at);
    collect_spi();
    if (board.spi_waiting) {
        said = board.spi_out[0];
        memmove(board.spi_out, board.spi_out + 1, --board.spi_waiting);
    }
    if (board.spi_held < SPI_FIFO) board.spi_in[board.spi_held++] = value;
    board.spi_last = board.now;
    touched();
    return said;
}

int navi_is_in_loader(void) { return board.is_in_loader; }
