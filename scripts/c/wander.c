/* Wander through the maze without hitting a wall: a sample to start your own program from.
 *
 *     cc -o wander wander.c -lm
 *     simmer-tui --run "./wander 20"
 */
#include "simmer.h"

int main(int count, char **arguments) {
    const char *codes[] = {"u1", "u2", "u4"};
    double distance[3];
    simmer_robot robot;
    int step, steps = count > 1 ? atoi(arguments[1]) : 20;
    if (simmer_open(&robot, NULL, 0, -1) != SIMMER_OK) {
        fprintf(stderr, "wander: %s\n", robot.error);
        return 1;
    }
    for (step = 1; step <= steps; step++) {
        int result = simmer_read(&robot, codes, 3, distance);
        int is_free = distance[0] > 6 && distance[1] > 3.5 && distance[2] > 3.5;
        if (result == SIMMER_OK)
            result = is_free ? simmer_drive(&robot, "d1", 2, NULL)
                             : simmer_drive(&robot, "r1", distance[1] > distance[2] ? 30 : -30, NULL);
        if (result != SIMMER_OK) {
            fprintf(stderr, "wander: %s\n", robot.error);
            return 1;
        }
        printf("%d: u1=%.2f u2=%.2f u4=%.2f -> %s\n", step, distance[0], distance[1], distance[2],
               is_free ? "drive" : "turn");
    }
    simmer_close(&robot);
    return 0;
}
