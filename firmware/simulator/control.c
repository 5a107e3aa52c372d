#define _GNU_SOURCE
#include "control.h"

#include <errno.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

enum { MAX_WORDS = 8 };

void control_init(control_t *control, board_t *board, const char *path, bool real_time) {
  struct sockaddr_un address = {.sun_family = AF_UNIX};
  *control = (control_t){.board = board, .real_time = real_time, .client = -1};
  control->listener = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (strlen(path) >= sizeof address.sun_path) {
    fprintf(stderr, "%s: too long for a UNIX socket\n", path);
    exit(1);
  }
  strcpy(address.sun_path, path);
  unlink(path);
  if (bind(control->listener, (struct sockaddr *)&address, sizeof address) < 0 || listen(control->listener, 1) < 0) {
    perror(path);
    exit(1);
  }
}

void control_accept(control_t *control) {
  const int client = accept4(control->listener, NULL, NULL, SOCK_CLOEXEC);
  if (client < 0)
    return;
  if (control->client >= 0)
    close(control->client);
  control->client = client;
  control->length = 0;
  control->waiting = false;
}

__attribute__((format(printf, 2, 3))) static void answer(control_t *control, const char *format, ...) {
  char text[1024];
  va_list arguments;
  va_start(arguments, format);
  int length = vsnprintf(text, sizeof text - 1, format, arguments);
  va_end(arguments);
  text[length++] = '\n';
  for (int sent = 0; sent < length;) {
    const ssize_t count = send(control->client, text + sent, length - sent, MSG_NOSIGNAL);
    if (count <= 0)
      return; /* gone: the next read says so */
    sent += count;
  }
}

static void answer_time(control_t *control) {
  answer(control, "ok %" PRIu64 " %" PRIu64, board_now_us(control->board), control->board->uart.sent);
}

void control_continue(control_t *control) {
  board_t *board = control->board;
  if (!control->waiting || board->pty.read_total < control->run_received)
    return;
  control->waiting = false;
  if (board_run_until(board, board_now_us(board) + control->run_us))
    answer_time(control);
  else
    answer(control, "error the firmware crashed at %" PRIu64, board_now_us(board));
}

static void answer_registers(control_t *control, const bno055_t *chip, unsigned first, unsigned count) {
  char text[2 * BNO055_REGISTERS + 1] = "";
  for (unsigned i = 0; i < count; i++)
    sprintf(text + 2 * i, "%02x", chip->registers[(first + i) % BNO055_REGISTERS]);
  answer(control, "ok %s", text);
}

static void answer_stats(control_t *control) {
  const board_t *board = control->board;
  unsigned violations = board->panel.violations, boots = 0;
  for (unsigned k = 0; k < BUS_CHANNELS; k++) {
    violations += board->bus.chips[k].violations;
    boots += board->bus.chips[k].boots;
  }
  answer(control,
         "ok transfers=%u bytes=%u clock_pulses=%u multiplexer_resets=%u violations=%u boots=%u received=%" PRIu64
         " overruns=%u dropped=%" PRIu64,
         board->bus.transfers, board->bus.bytes, board->bus.clock_pulses, board->bus.multiplexer_resets, violations,
         boots, board->uart.received, board->uart.overruns, board->pty.dropped);
}

static void answer_display(control_t *control) {
  char rows[PANEL_ROWS][PANEL_COLUMNS + 1];
  for (unsigned row = 0; row < PANEL_ROWS; row++)
    panel_read(&control->board->panel, row, rows[row]);
  answer(control, "ok %s|%s", rows[0], rows[1]);
}

/* ---- the commands ---- */
typedef struct {
  const char *name;
  unsigned least, most; /* words after the name */
} form_t;

static const form_t FORMS[] = {
    {"run", 1, 2},     {"time", 0, 0},    {"quaternion", 5, 5}, {"acceleration", 4, 4}, {"magnetometer", 4, 4},
    {"gyroscope", 4, 4}, {"calibration", 2, 2}, {"pattern", 2, 2}, {"stretch", 2, 2},   {"glitch", 2, 2},
    {"refuse", 2, 2},  {"unplug", 1, 1},  {"plug", 1, 1},     {"blip", 1, 1},         {"hold", 2, 3},
    {"release", 1, 1}, {"cable", 1, 1},
    {"reset", 0, 0},   {"power", 0, 0},   {"register", 2, 3},   {"mode", 1, 1},         {"display", 0, 0},
    {"button", 1, 1},  {"stats", 0, 0},   {"poke", 3, 3},
};

static long number(const char *word) { return strtol(word, NULL, 0); }

/* The channel that a word names, BUS_TRUNK for `other`, or -1. */
static int place(const char *word, const char *other) {
  if (word[0] >= '0' && word[0] < '0' + BUS_CHANNELS && !word[1])
    return word[0] - '0';
  return other && strcmp(word, other) == 0 ? BUS_TRUNK : -1;
}

/* Commands about one chip; false if it is none of them. */
static bool execute_on_chip(control_t *control, bno055_t *chip, const char *name, char **words, unsigned count) {
  const uint64_t now_us = board_now_us(control->board);
  if (!strcmp(name, "quaternion")) {
    for (unsigned i = 0; i < 4; i++)
      chip->quaternion[i] = (int16_t)number(words[1 + i]);
  } else if (!strcmp(name, "acceleration")) {
    for (unsigned i = 0; i < 3; i++)
      chip->acceleration[i] = (int16_t)number(words[1 + i]);
  } else if (!strcmp(name, "magnetometer")) {
    for (unsigned i = 0; i < 3; i++)
      chip->magnetic_field[i] = (int16_t)number(words[1 + i]);
  } else if (!strcmp(name, "gyroscope")) {
    for (unsigned i = 0; i < 3; i++)
      chip->angular_velocity[i] = (int16_t)number(words[1 + i]);
  } else if (!strcmp(name, "calibration")) {
    chip->calibration = (uint8_t)number(words[1]);
  } else if (!strcmp(name, "pattern")) {
    chip->pattern = number(words[1]);
  } else if (!strcmp(name, "stretch")) {
    chip->stretch_us = (uint32_t)number(words[1]);
  } else if (!strcmp(name, "glitch")) {
    chip->glitches = number(words[1]);
  } else if (!strcmp(name, "refuse")) {
    chip->refuses_offsets = number(words[1]);
  } else if (!strcmp(name, "poke")) {
    chip->registers[number(words[1]) % BNO055_REGISTERS] = (uint8_t)number(words[2]);
  } else if (!strcmp(name, "blip")) {
    bno055_power(chip, false, now_us);
    bno055_power(chip, true, now_us);
  } else if (!strcmp(name, "register")) {
    const long registers = count > 2 ? number(words[2]) : 1;
    answer_registers(control, chip, number(words[1]), registers > BNO055_REGISTERS ? BNO055_REGISTERS : registers);
    return true;
  } else if (!strcmp(name, "mode")) {
    answer(control, "ok %u", chip->mode);
    return true;
  } else {
    return false;
  }
  answer(control, "ok");
  return true;
}

/* Commands about a channel or about what all channels share; false if it is none of them. */
static bool execute_on_bus(control_t *control, const char *name, char **words, unsigned count) {
  board_t *board = control->board;
  const bool plugging = !strcmp(name, "plug") || !strcmp(name, "unplug");
  const bool holding = !strcmp(name, "hold") || !strcmp(name, "release");
  if (!plugging && !holding)
    return false;
  const int where = place(words[0], plugging ? "multiplexer" : "trunk");
  if (where < 0) {
    answer(control, "error %s: no channel %s", name, words[0]);
    return true;
  }
  if (plugging) {
    const bool on = !strcmp(name, "plug");
    if (where == BUS_TRUNK)
      bus_power_multiplexer(&board->bus, on);
    else
      bno055_power(&board->bus.chips[where], on, board_now_us(board));
  } else if (!strcmp(name, "hold")) {
    bus_hold(&board->bus, where, !strcmp(words[1], "sda"), !strcmp(words[1], "scl"), count > 2 ? number(words[2]) : 0);
  } else {
    bus_release(&board->bus, where);
  }
  answer(control, "ok");
  return true;
}

static void execute_on_board(control_t *control, const char *name, char **words, unsigned count) {
  board_t *board = control->board;
  if (!strcmp(name, "run")) {
    if (control->real_time)
      return answer(control, "error run: time runs by itself");
    control->run_us = strtoull(words[0], NULL, 0);
    control->run_received = count > 1 ? strtoull(words[1], NULL, 0) : 0;
    control->waiting = true;
    board_exchange(board);
    return control_continue(control);
  }
  if (!strcmp(name, "time"))
    return answer_time(control);
  if (!strcmp(name, "stats"))
    return answer_stats(control);
  if (!strcmp(name, "display"))
    return answer_display(control);
  if (!strcmp(name, "button"))
    panel_press(&board->panel, number(words[0]));
  else if (!strcmp(name, "reset"))
    board_reset(board);
  else if (!strcmp(name, "power"))
    board_power_cycle(board);
  else if (strcmp(name, "cable"))
    return answer(control, "error %s: no channel %s", name, words[0]);
  else if (number(words[0]))
    pty_plug(&board->pty);
  else
    pty_unplug(&board->pty);
  answer(control, "ok");
}

static void execute(control_t *control, char *line) {
  char *words[MAX_WORDS], *rest = NULL;
  unsigned count = 0;
  for (char *word = strtok_r(line, " ", &rest); word && count < MAX_WORDS; word = strtok_r(NULL, " ", &rest))
    words[count++] = word;
  if (count == 0)
    return answer(control, "error an empty line");
  const char *name = words[0];
  for (unsigned i = 0; i < sizeof FORMS / sizeof *FORMS; i++) {
    if (strcmp(name, FORMS[i].name))
      continue;
    const unsigned given = count - 1;
    if (given < FORMS[i].least || given > FORMS[i].most)
      return answer(control, "error %s: got %u words, expected %u to %u", name, given, FORMS[i].least, FORMS[i].most);
    const int channel = given ? place(words[1], NULL) : -1;
    if (channel >= 0 && execute_on_chip(control, &control->board->bus.chips[channel], name, words + 1, given))
      return;
    if (!execute_on_bus(control, name, words + 1, given))
      execute_on_board(control, name, words + 1, given);
    return;
  }
  answer(control, "error no command %s", name);
}

bool control_serve(control_t *control) {
  const ssize_t count = recv(control->client, control->line + control->length, sizeof control->line - control->length, 0);
  if (count <= 0) {
    close(control->client);
    control->client = -1;
    return false;
  }
  control->length += count;
  for (char *end; (end = memchr(control->line, '\n', control->length));) {
    *end = 0;
    execute(control, control->line);
    control->length -= end + 1 - control->line;
    memmove(control->line, end + 1, control->length);
  }
  if (control->length == sizeof control->line)
    control->length = 0; /* no command is that long */
  return true;
}
