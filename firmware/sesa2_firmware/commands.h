/* Answers the PC's commands. */
#ifndef SESA2_COMMANDS_H
#define SESA2_COMMANDS_H

namespace commands {

void poll();

}  // namespace commands

#endif
