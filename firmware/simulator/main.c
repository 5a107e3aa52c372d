/* simulated_board FIRMWARE.elf --port LINK --control SOCKET [--real-time]

   LINK becomes a symbolic link to the pseudo-terminal that stands for the board's USB port. Without --real-time, simulated
   time moves only when a `run` on SOCKET moves it (control.h), and the board ends with the connection that moved it. With
   it, simulated time follows the clock on the wall as well as the machine can. */
#define _GNU_SOURCE
#include <errno.h>
#include <getopt.h>
#include <inttypes.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "board.h"
#include "control.h"

enum { TICK_US = 1000, MAX_LAG_US = 50000 };

static volatile sig_atomic_t stopped;

static void stop(int signal) {
  (void)signal;
  stopped = 1;
}

static uint64_t wall_us(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (uint64_t)now.tv_sec * 1000000 + now.tv_nsec / 1000;
}

/* Waits for the control socket and the pseudo-terminal; returns whether the board goes on. */
static bool serve(control_t *control, int timeout_ms) {
  const pty_t *pty = &control->board->pty;
  const bool pty_wanted = pty->controller >= 0 && (control->waiting || pty->pending_count);
  struct pollfd fds[] = {
      {.fd = control->listener, .events = POLLIN},
      {.fd = control->client, .events = POLLIN},
      {.fd = pty_wanted ? pty->controller : -1,
       .events = (control->waiting ? POLLIN : 0) | (pty->pending_count ? POLLOUT : 0)},
  };
  if (poll(fds, 3, timeout_ms) < 0)
    return errno == EINTR;
  if (fds[2].revents) {
    board_exchange(control->board);
    control_continue(control);
  }
  if (fds[0].revents)
    control_accept(control);
  else if (fds[1].revents)
    return control_serve(control) || control->real_time;
  return true;
}

static int run_stepped(control_t *control) {
  while (!stopped && serve(control, -1))
    ;
  return 0;
}

static int run_in_real_time(control_t *control) {
  board_t *board = control->board;
  uint64_t start_us = wall_us();
  while (!stopped) {
    const uint64_t target_us = wall_us() - start_us;
    const uint64_t now_us = board_now_us(board);
    if (target_us > now_us + MAX_LAG_US)
      start_us += target_us - now_us; /* a machine that was held up does not catch up: the board's clock stood still */
    else if (target_us > now_us && !board_run_until(board, now_us + TICK_US)) {
      fprintf(stderr, "the firmware crashed at %" PRIu64 " us\n", board_now_us(board));
      return 1;
    }
    if (!serve(control, board_now_us(board) > wall_us() - start_us ? 1 : 0))
      return 0;
  }
  return 0;
}

int main(int argc, char **argv) {
  static const struct option options[] = {
      {"port", required_argument, NULL, 'p'},
      {"control", required_argument, NULL, 'c'},
      {"real-time", no_argument, NULL, 'r'},
      {0},
  };
  const char *port = NULL, *socket_path = NULL;
  bool real_time = false;
  for (int option; (option = getopt_long(argc, argv, "", options, NULL)) != -1;) {
    if (option == 'p')
      port = optarg;
    else if (option == 'c')
      socket_path = optarg;
    else if (option == 'r')
      real_time = true;
    else
      return 2;
  }
  if (optind != argc - 1 || !port || !socket_path) {
    fprintf(stderr, "usage: %s FIRMWARE.elf --port LINK --control SOCKET [--real-time]\n", argv[0]);
    return 2;
  }
  signal(SIGPIPE, SIG_IGN);
  const struct sigaction action = {.sa_handler = stop};
  sigaction(SIGTERM, &action, NULL);
  sigaction(SIGINT, &action, NULL);

  static board_t board;
  static control_t control;
  board_init(&board, argv[optind], port);
  control_init(&control, &board, socket_path, real_time);
  const int status = real_time ? run_in_real_time(&control) : run_stepped(&control);
  pty_unplug(&board.pty);
  unlink(socket_path);
  return status;
}
