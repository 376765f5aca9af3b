/* @TITLE@ over a CSV.
 *
 *     ./@NAME@ run.csv > estimates.csv
 *     ./@NAME@ check replay.csv 1e-9
 *
 * The first line of the file names its columns; inputs and measurements are looked for by the names in @NAME@.h, in SI
 * units, a line for each sample. An empty cell or nan is a measurement that is missing. With check the columns of the
 * file that are called as results are compared with these: the largest difference over the largest magnitude. */
#include "@NAME@.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define INPUTS @UPPER@_INPUTS
#define GIVEN (@UPPER@_INPUTS + @UPPER@_MEASUREMENTS)
#define RESULTS (2 * @UPPER@_ESTIMATES + 1)
#define MOST 1000 /* columns of a file */

static const char *const given[] = {@GIVEN@};
static const char *const results[] = {@RESULTS@};

static @NAME@ estimator;
static char line[1 << 16];
static char *cells[MOST];

static int read_line(FILE *file) {
    int count = 0;
    char *at = line;
    if (fgets(line, sizeof line, file) == NULL) {
        return 0;
    }
    line[strcspn(line, "\r\n")] = '\0';
    while (count < MOST) {
        cells[count++] = at;
        at = strchr(at, ',');
        if (at == NULL) {
            break;
        }
        *at++ = '\0';
    }
    return count;
}

static int column_of(const char *name, int count) {
    for (int i = 0; i < count; i++) {
        if (strcmp(cells[i], name) == 0) {
            return i;
        }
    }
    return -1;
}

static double number(int column, int count) {
    return column < 0 || column >= count || cells[column][0] == '\0' ? (double) NAN : strtod(cells[column], NULL);
}

static void step(const double *values, double *told, bool *outside) {
    @NAME@_inputs inputs;
    @NAME@_measurements measurements;
    @NAME@_outcome outcome;
@STEP@
    *outside = outcome.outside;
}

int main(int argc, char **argv) {
    int checks = argc > 1 && strcmp(argv[1], "check") == 0;
    const char *path = argc > 1 + checks ? argv[1 + checks] : NULL;
    double tolerance = argc > 3 ? strtod(argv[3], NULL) : @TOLERANCE@;
    int columns[GIVEN + 1], expected[RESULTS], count, failed = 0;
    double values[GIVEN + 1], told[RESULTS], off[RESULTS] = {0.0}, largest[RESULTS] = {0.0};
    long samples = 0;
    bool outside = false;
    @NAME@_belief belief;
    FILE *file = path == NULL ? NULL : fopen(path, "r");
    if (file == NULL || (count = read_line(file)) == 0) {
        fprintf(stderr, "usage: %s [check] FILE.csv [TOLERANCE]; a file that can be read\n", argv[0]);
        return 2;
    }
    for (int i = 0; i < GIVEN; i++) {
        columns[i] = column_of(given[i], count);
        if (columns[i] < 0 && i < INPUTS) {
            fprintf(stderr, "%s has no column '%s', which is an input\n", path, given[i]);
            return 2;
        }
    }
    for (int i = 0; i < RESULTS; i++) {
        expected[i] = column_of(results[i], count);
        if (checks && expected[i] < 0 && i < @UPPER@_ESTIMATES) {
            fprintf(stderr, "%s has no column '%s' to compare with\n", path, results[i]);
            return 2;
        }
        printf("%s%s", checks ? "" : results[i], checks ? "" : ",");
    }
    fputs(checks ? "" : "outside\n", stdout);
    @NAME@_believe(&belief);
    @NAME@_begin(&estimator, &belief);
    while ((count = read_line(file)) > 0) {
        for (int i = 0; i < GIVEN; i++) {
            values[i] = number(columns[i], count);
            if (i < INPUTS && isnan(values[i])) {
                fprintf(stderr, "%s: line %ld: input '%s' is no number\n", path, samples + 2, given[i]);
                return 2;
            }
        }
        step(values, told, &outside);
        for (int i = 0; i < RESULTS; i++) {
            double other = number(expected[i], count);
            if (!checks) {
                printf("%.9g,", told[i]);
            } else if (isnan(told[i]) != isnan(other) && expected[i] >= 0) {
                off[i] = (double) INFINITY;
            } else if (!isnan(other)) {
                off[i] = fmax(off[i], fabs(told[i] - other));
                largest[i] = fmax(largest[i], fabs(other));
            }
        }
        fputs(checks ? "" : outside ? "1\n" : "0\n", stdout);
        samples++;
    }
    fclose(file);
    for (int i = 0; checks && i < RESULTS; i++) {
        double relative = largest[i] > 0.0 ? off[i] / largest[i] : off[i];
        failed = failed || !(relative <= tolerance);
        printf("%-40s %.3g of its largest magnitude %.6g\n", results[i], relative, largest[i]);
    }
    failed = failed || (checks && samples == 0);
    if (checks) {
        printf("%ld samples, %lu bytes of memory: %s\n", samples, (unsigned long) sizeof estimator,
               failed ? "FAILED" : "as recorded");
    }
    return failed;
}
