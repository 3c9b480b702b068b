/* A robot in the simulator, driven from C or C++: one header, nothing but the system's sockets.
 *
 *     #include "simmer.h"
 *
 *     simmer_robot robot;
 *     double ahead[2];
 *     const char *codes[] = {"u2", "u4"};
 *     if (simmer_open(&robot, NULL, 0, -1) != SIMMER_OK) { puts(robot.error); return 1; }
 *     simmer_read(&robot, codes, 2, ahead);           // both in one round trip, inches
 *     simmer_drive(&robot, "d1", 3.0, NULL);          // returns when the movement has ended
 *     simmer_close(&robot);
 *
 * C99 (with -std=c99 included before all other headers) or C++11; Linux, macOS, Windows (link with ws2_32; not tried).
 * Every function returns SIMMER_OK, SIMMER_REFUSED (the robot did nothing; the connection continues) or
 * SIMMER_FAILED (the connection has ended); robot.error says why.
 *
 * The protocol: a command is a line of ASCII on one connection. Its reply is one IEEE 754 number, for a lidar a
 * count and that many numbers, on a second connection if the simulator has one. Infinity says that a movement has
 * ended (at a wall, too), NaN that a command was refused. A microcontroller without sockets sends the same lines
 * over its own link.
 */
#ifndef SIMMER_H
#define SIMMER_H

#if defined(__linux__) && defined(__STRICT_ANSI__) && !defined(_POSIX_C_SOURCE)
#define _POSIX_C_SOURCE 200112L /* otherwise -std=c99 hides getaddrinfo */
#endif

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#include <winsock2.h>
#include <ws2tcpip.h>
typedef SOCKET simmer_socket;
#define SIMMER_NO_SOCKET INVALID_SOCKET
#define simmer_close_socket closesocket
#else
#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>
#ifndef AI_PASSIVE
#error "with -std=c99 include simmer.h before all other headers, or compile with -D_POSIX_C_SOURCE=200112L"
#endif
typedef int simmer_socket;
#define SIMMER_NO_SOCKET (-1)
#define simmer_close_socket close
#endif

#ifdef MSG_NOSIGNAL /* a connection that has ended is an error, not a signal */
#define SIMMER_SEND_FLAGS MSG_NOSIGNAL
#else
#define SIMMER_SEND_FLAGS 0
#endif

enum { SIMMER_OK = 0, SIMMER_REFUSED = 1, SIMMER_FAILED = 2 };
#ifndef SIMMER_TIMEOUT
#define SIMMER_TIMEOUT 30 /* seconds to wait for a reply: movements in timed motion take long */
#endif
enum { SIMMER_MOST = 64, SIMMER_LONGEST = 255 }; /* commands in one go; characters of a command */
enum { SIMMER_MOST_RANGES = 4000 };              /* of a scan; a number above that is no count */
enum { SIMMER_FACTS = 7, SIMMER_MOST_CELLS = 64 }; /* of a mission, and cells of its loading zone after them */

typedef struct simmer_robot {
    simmer_socket commands, replies, beliefs;
    char host[256];
    int reply_bytes;   /* 8, or 4 where the simulator runs with --reply-format float32 */
    int little_endian; /* 1 where it runs with --byte-order little */
    int timeout;       /* seconds to wait for a reply */
    char error[512];
} simmer_robot;

static inline int simmer_fail(simmer_robot *robot, int code, const char *what, const char *command) {
    snprintf(robot->error, sizeof robot->error, "%s%s%.300s%s", what, command[0] ? ": '" : "", command,
             command[0] ? "'" : "");
    return code;
}

static inline void simmer_close(simmer_robot *robot) {
    if (robot->replies != SIMMER_NO_SOCKET && robot->replies != robot->commands)
        simmer_close_socket(robot->replies);
    if (robot->commands != SIMMER_NO_SOCKET) simmer_close_socket(robot->commands);
    if (robot->beliefs != SIMMER_NO_SOCKET) simmer_close_socket(robot->beliefs);
    robot->commands = robot->replies = robot->beliefs = SIMMER_NO_SOCKET;
}

static inline int simmer_send_all(simmer_socket connection, const char *data, size_t size) {
    while (size > 0) {
        int sent = (int)send(connection, data, (int)size, SIMMER_SEND_FLAGS);
        if (sent <= 0) return 0;
        data += sent;
        size -= (size_t)sent;
    }
    return 1;
}

/* Seconds that a reply may take. */
static inline void simmer_set_timeout(simmer_socket connection, int timeout) {
#ifdef _WIN32
    DWORD wait = (DWORD)timeout * 1000;
#else
    struct timeval wait = {timeout, 0};
#endif
    setsockopt(connection, SOL_SOCKET, SO_RCVTIMEO, (const char *)&wait, sizeof wait);
}

static inline simmer_socket simmer_connect(const char *host, int port, int timeout) {
    struct addrinfo hints, *found = NULL, *each;
    simmer_socket connection = SIMMER_NO_SOCKET;
    const char *token = getenv("SIMMER_TOKEN");
    int one = 1;
    char number[16];
    memset(&hints, 0, sizeof hints);
    hints.ai_socktype = SOCK_STREAM;
    snprintf(number, sizeof number, "%d", port);
    if (getaddrinfo(host, number, &hints, &found) != 0) return SIMMER_NO_SOCKET;
    for (each = found; each != NULL && connection == SIMMER_NO_SOCKET; each = each->ai_next) {
        connection = socket(each->ai_family, each->ai_socktype, each->ai_protocol);
        if (connection == SIMMER_NO_SOCKET) continue;
        if (connect(connection, each->ai_addr, (socklen_t)each->ai_addrlen) != 0) {
            simmer_close_socket(connection);
            connection = SIMMER_NO_SOCKET;
        }
    }
    freeaddrinfo(found);
    if (connection == SIMMER_NO_SOCKET) return connection;
    setsockopt(connection, IPPROTO_TCP, TCP_NODELAY, (const char *)&one, sizeof one);
    simmer_set_timeout(connection, timeout);
    if (token != NULL && token[0] &&
        (!simmer_send_all(connection, token, strlen(token)) || !simmer_send_all(connection, "\n", 1))) {
        simmer_close_socket(connection);
        return SIMMER_NO_SOCKET;
    }
    return connection;
}

static inline int simmer_port(int given, const char *variable, int usual) {
    const char *text = getenv(variable);
    return given >= 0 ? given : text != NULL && text[0] ? atoi(text) : usual;
}

/* Connect. host NULL: SIMMER_HOST, else 127.0.0.1. port 0 or less: SIMMER_PORT, else 9000. reply_port -1:
 * SIMMER_REPLY_PORT, else 9001 beside 9000; 0, or where nobody listens: replies come on the command port. */
static inline int simmer_open(simmer_robot *robot, const char *host, int port, int reply_port) {
    memset(robot, 0, sizeof *robot);
    robot->commands = robot->replies = robot->beliefs = SIMMER_NO_SOCKET;
    robot->reply_bytes = 8;
    robot->timeout = SIMMER_TIMEOUT;
#ifdef _WIN32
    {
        WSADATA data;
        if (WSAStartup(MAKEWORD(2, 2), &data) != 0)
            return simmer_fail(robot, SIMMER_FAILED, "Windows Sockets cannot be started", "");
    }
#endif
    if (host == NULL) host = getenv("SIMMER_HOST");
    snprintf(robot->host, sizeof robot->host, "%s", host != NULL && host[0] ? host : "127.0.0.1");
    port = simmer_port(port > 0 ? port : -1, "SIMMER_PORT", 9000);
    reply_port = simmer_port(reply_port, "SIMMER_REPLY_PORT", port == 9000 ? 9001 : 0);
    robot->commands = simmer_connect(robot->host, port, robot->timeout);
    if (robot->commands == SIMMER_NO_SOCKET)
        return simmer_fail(robot, SIMMER_FAILED, "no simulator answers there; start it with simmer-tui",
                           robot->host);
    if (reply_port > 0) robot->replies = simmer_connect(robot->host, reply_port, robot->timeout);
    if (robot->replies == SIMMER_NO_SOCKET) robot->replies = robot->commands;
    return SIMMER_OK;
}

static inline double simmer_number(const simmer_robot *robot, const unsigned char *bytes) {
    uint64_t bits = 0;
    int i;
    for (i = 0; i < robot->reply_bytes; i++)
        bits = bits << 8 | bytes[robot->little_endian ? robot->reply_bytes - 1 - i : i];
    if (robot->reply_bytes == 4) {
        uint32_t half = (uint32_t)bits;
        float number;
        memcpy(&number, &half, sizeof number);
        return number;
    } else {
        double number;
        memcpy(&number, &bits, sizeof number);
        return number;
    }
}

/* 1 if more has come than has been read, or comes within some milliseconds. */
static inline int simmer_has_more(const simmer_robot *robot, int milliseconds) {
    struct timeval wait = {0, milliseconds * 1000};
    fd_set set;
    FD_ZERO(&set);
    FD_SET(robot->replies, &set);
    return select((int)robot->replies + 1, &set, NULL, NULL, &wait) > 0;
}

/* Receive so many numbers of the reply to a command. */
static inline int simmer_receive(simmer_robot *robot, const char *command, int count, double *numbers) {
    unsigned char bytes[SIMMER_MOST * 8];
    while (count > 0) {
        int i, some = count < SIMMER_MOST ? count : SIMMER_MOST;
        size_t came = 0, wanted = (size_t)some * (size_t)robot->reply_bytes;
        while (came < wanted) {
            int piece = (int)recv(robot->replies, (char *)bytes + came, (int)(wanted - came), 0);
            if (piece <= 0) { /* a late reply would be taken for the next one's: the connection ends */
                simmer_close(robot);
                return simmer_fail(robot, SIMMER_FAILED,
                                   piece == 0 ? "the simulator has ended the connection, or another program drives"
                                              : "no reply came in time",
                                   command);
            }
            came += (size_t)piece;
        }
        for (i = 0; i < some; i++)
            *numbers++ = simmer_number(robot, bytes + (size_t)i * (size_t)robot->reply_bytes);
        count -= some;
    }
    return SIMMER_OK;
}

/* Send commands in one go. */
static inline int simmer_send_lines(simmer_robot *robot, const char *const *commands, int count) {
    char lines[SIMMER_MOST * (SIMMER_LONGEST + 1) + 1];
    size_t used = 0;
    int i;
    if (robot->commands == SIMMER_NO_SOCKET)
        return simmer_fail(robot, SIMMER_FAILED, "the connection has ended; open the robot again", "");
    if (count < 1 || count > SIMMER_MOST)
        return simmer_fail(robot, SIMMER_REFUSED, "there must be 1 to 64 commands; nothing was sent", "");
    for (i = 0; i < count; i++) {
        size_t length = strlen(commands[i]);
        if (length > SIMMER_LONGEST || strpbrk(commands[i], "\r\n") != NULL)
            return simmer_fail(robot, SIMMER_REFUSED, "this is no command; nothing was sent", commands[i]);
        memcpy(lines + used, commands[i], length);
        used += length;
        lines[used++] = '\n';
    }
    if (!simmer_send_all(robot->commands, lines, used)) {
        simmer_close(robot);
        return simmer_fail(robot, SIMMER_FAILED, "the simulator has ended the connection", commands[0]);
    }
    return SIMMER_OK;
}

/* Send commands as they stand ("u1", "d1-3") in one go, and wait for the number of each. */
static inline int simmer_send_many(simmer_robot *robot, const char *const *commands, int count, double *replies) {
    int code = simmer_send_lines(robot, commands, count);
    if (code == SIMMER_OK) code = simmer_receive(robot, commands[0], count, replies);
    if (code == SIMMER_OK && simmer_has_more(robot, 0)) { /* what comes next would be nonsense */
        simmer_close(robot);
        return simmer_fail(robot, SIMMER_FAILED, "more came back than a number: set reply_bytes, or use simmer_scan",
                           commands[0]);
    }
    return code;
}

/* Send one command. Infinity: a movement has ended; NaN: it was refused (and no error here). */
static inline int simmer_send(simmer_robot *robot, const char *command, double *reply) {
    return simmer_send_many(robot, &command, 1, reply);
}

/* Read several sensors by their codes in one round trip: inches and degrees. */
static inline int simmer_read(simmer_robot *robot, const char *const *codes, int count, double *values) {
    int i, code = simmer_send_many(robot, codes, count, values);
    for (i = 0; code == SIMMER_OK && i < count; i++)
        if (isnan(values[i]))
            return simmer_fail(robot, SIMMER_REFUSED, "the robot knows no such sensor, or it is disabled",
                               codes[i]);
    return code;
}

/* All ranges of the last whole turn of a lidar, inches, ray by ray: the first `most` of them into `ranges`, and
 * how many there are into *count. Infinity: a ray met nothing in reach. One ray alone is simmer_send("sc-90"). */
static inline int simmer_scan(simmer_robot *robot, const char *code, double *ranges, int most, int *count) {
    double number = 0, rest;
    int i, result = simmer_send_lines(robot, &code, 1);
    *count = 0;
    if (result == SIMMER_OK) result = simmer_receive(robot, code, 1, &number);
    if (result != SIMMER_OK) return result;
    if (isnan(number))
        return simmer_fail(robot, SIMMER_REFUSED, "the robot knows no such lidar, or it is disabled", code);
    /* a whole number may be another sensor's reading, which nothing follows */
    if (!(number >= 1 && number <= SIMMER_MOST_RANGES && number == floor(number)) || !simmer_has_more(robot, 200)) {
        if (!simmer_has_more(robot, 0)) return simmer_fail(robot, SIMMER_REFUSED, "this is no lidar", code);
        simmer_close(robot);
        return simmer_fail(robot, SIMMER_FAILED, "no count came back: set reply_bytes and little_endian", code);
    }
    *count = (int)number;
    for (i = 0; i < *count && result == SIMMER_OK; i++)
        result = simmer_receive(robot, code, 1, i < most ? ranges + i : &rest);
    return result;
}

/* The facts of a mission that a program may know. Places are the middles of cells, inches; the time limit is in
 * simulated seconds. Where the robot has to find its start, start_x, start_y and start_heading are NaN. */
typedef struct simmer_mission {
    double drop_x, drop_y, time_limit;
    char gripper[3]; /* its code, "" where nobody tells it */
    double start_x, start_y, start_heading;
    int cells; /* of the loading zone: the first ones are in loading_x, loading_y */
    double loading_x[SIMMER_MOST_CELLS], loading_y[SIMMER_MOST_CELLS];
} simmer_mission;

/* Ask for the facts of the mission, over the command connection; it takes no simulated time. The variables
 * SIMMER_DROP_ZONE and SIMMER_TIME_LIMIT, where they are set, count first. Without a mission: SIMMER_REFUSED. */
static inline int simmer_get_mission(simmer_robot *robot, simmer_mission *mission) {
    double facts[SIMMER_FACTS + 2 * SIMMER_MOST_CELLS];
    const char *zone = getenv("SIMMER_DROP_ZONE"), *limit = getenv("SIMMER_TIME_LIMIT");
    int i, given, count = 0, result = simmer_scan(robot, "?m", facts, (int)(sizeof facts / sizeof facts[0]), &count);
    memset(mission, 0, sizeof *mission);
    if (result == SIMMER_FAILED) return result;
    for (i = count; i < SIMMER_FACTS; i++) facts[i] = i == 3 ? 0 : i == 2 ? HUGE_VAL : NAN;
    mission->drop_x = facts[0];
    mission->drop_y = facts[1];
    mission->time_limit = facts[2];
    mission->gripper[0] = (char)((int)facts[3] / 256);
    mission->gripper[1] = (char)((int)facts[3] % 256);
    mission->start_x = facts[4];
    mission->start_y = facts[5];
    mission->start_heading = facts[6];
    mission->cells = count > SIMMER_FACTS ? (count - SIMMER_FACTS) / 2 : 0;
    if (mission->cells > SIMMER_MOST_CELLS) mission->cells = SIMMER_MOST_CELLS;
    for (i = 0; i < mission->cells; i++) {
        mission->loading_x[i] = facts[SIMMER_FACTS + 2 * i];
        mission->loading_y[i] = facts[SIMMER_FACTS + 2 * i + 1];
    }
    given = zone != NULL && sscanf(zone, "%lf,%lf", &mission->drop_x, &mission->drop_y) == 2;
    if (limit != NULL && limit[0]) mission->time_limit = atof(limit);
    if (count < SIMMER_FACTS && !given)
        return simmer_fail(robot, SIMMER_REFUSED,
                           "the simulator has no mission: end it, and start 'simmer-tui --mission'", "");
    return SIMMER_OK;
}

/* Move by so many inches or degrees; returns when the movement has ended. What the robot answered is in
 * *reply (may be NULL): Infinity from the simulator. A wall may have ended it early: read a sensor. */
static inline int simmer_drive(simmer_robot *robot, const char *code, double value, double *reply) {
    char command[64];
    double answer = 0.0;
    int result;
    snprintf(command, sizeof command, "%.2s-%.17g", code, value);
    result = simmer_send(robot, command, &answer);
    if (reply != NULL) *reply = answer;
    if (result == SIMMER_OK && isnan(answer))
        return simmer_fail(robot, SIMMER_REFUSED, "the robot refused it: no enabled drive, or beyond 1e6", command);
    return result;
}

/* Let so many seconds of the robot's time pass, while it continues its motion. The simulator's time is not
 * the computer's: sleep() moves a driving robot hardly at all. */
static inline int simmer_sleep(simmer_robot *robot, double seconds) {
    char command[64];
    double answer = 0.0;
    int result;
    snprintf(command, sizeof command, "wt-%.17g", seconds);
    /* In timed motion the answer comes when the time is over. More than an hour is refused at once. */
    simmer_set_timeout(robot->replies, robot->timeout + (seconds > 0 && seconds <= 3600 ? (int)seconds + 1 : 0));
    result = simmer_send(robot, command, &answer);
    simmer_set_timeout(robot->replies, robot->timeout);
    if (result == SIMMER_OK && !isinf(answer))
        return simmer_fail(robot, SIMMER_REFUSED, "the robot has no command to wait", command);
    return result;
}

/* 1 if somebody listens to beliefs. */
static inline int simmer_believes(simmer_robot *robot) {
    if (robot->commands == SIMMER_NO_SOCKET) return 0;
    if (robot->beliefs == SIMMER_NO_SOCKET)
        robot->beliefs = simmer_connect(robot->host, simmer_port(-1, "SIMMER_BELIEF_PORT", 9002), robot->timeout);
    return robot->beliefs != SIMMER_NO_SOCKET;
}

/* Say where the program believes the robot to be (inches, degrees; spread in inches, or negative for none).
 * It is drawn beside the truth; where nobody listens, nothing happens. */
static inline void simmer_believe(simmer_robot *robot, double x, double y, double heading, double spread) {
    char line[200], more[40] = "";
    if (!simmer_believes(robot)) return;
    if (spread >= 0) snprintf(more, sizeof more, ",\"spread\":%.6g", spread);
    snprintf(line, sizeof line, "{\"x\":%.9g,\"y\":%.9g,\"heading\":%.9g%s}\n", x, y, heading, more);
    simmer_send_all(robot->beliefs, line, strlen(line));
}

/* The same as a grid of probabilities: row 1 on top, each row from left to right, heading fastest; the first
 * heading is 0 degrees, the others follow counterclockwise. headings is 1 for a grid without. bounds are x0, y0, x1, y1 in
 * inches, or NULL for the whole maze. They need not sum to 1; at most 65,536 states. */
static inline void simmer_believe_grid(simmer_robot *robot, const float *p, int rows, int cols, int headings,
                                       const double *bounds) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    char text[4096], where[120] = "";
    unsigned char three[3];
    size_t i, held = 0, used, bytes = (size_t)rows * (size_t)cols * (size_t)headings * 4;
    if (!simmer_believes(robot)) return;
    if (bounds != NULL)
        snprintf(where, sizeof where, "\"bounds\":[%.9g,%.9g,%.9g,%.9g],", bounds[0], bounds[1], bounds[2], bounds[3]);
    used = (size_t)snprintf(text, sizeof text, "{\"grid\":{\"rows\":%d,\"cols\":%d,\"headings\":%d,%s\"f32\":\"",
                            rows, cols, headings, where);
    for (i = 0; i < bytes; i++) {
        uint32_t bits; /* little-endian, whatever this machine is */
        memcpy(&bits, p + i / 4, sizeof bits);
        three[held++] = (unsigned char)(bits >> 8 * (i % 4));
        if (held < 3 && i + 1 < bytes) continue;
        memset(three + held, 0, 3 - held);
        text[used++] = digits[three[0] >> 2];
        text[used++] = digits[(three[0] & 3) << 4 | three[1] >> 4];
        text[used++] = held > 1 ? digits[(three[1] & 15) << 2 | three[2] >> 6] : '=';
        text[used++] = held > 2 ? digits[three[2] & 63] : '=';
        held = 0;
        if (used + 8 > sizeof text) {
            if (!simmer_send_all(robot->beliefs, text, used)) return;
            used = 0;
        }
    }
    memcpy(text + used, "\"}}\n", 4);
    simmer_send_all(robot->beliefs, text, used + 4);
}

#endif
