/* @TITLE@ over a CSV.
 *
 *     ./@NAME@ run.csv > estimates.csv
 *     ./@NAME@ check replay.csv 1e-9
 *
 * The first line of the file names its columns; inputs and measurements are looked for by the names in
 * @NAME@.h, in SI units, a line for each sample.
 * Cells are separated by commas and may be in quotes. An empty cell or nan is a measurement that is missing.
 * A column time has to go on by the estimator's step, @STEP@ s.
 * With check the columns of the file that are called as results are compared with these: the largest
 * difference over the largest magnitude. */
#include "@NAME@.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define INPUTS @UPPER@_INPUTS
#define GIVEN (@UPPER@_INPUTS + @UPPER@_MEASUREMENTS)
#define RESULTS @COUNT@
#define MOST 1000 /* columns of a file */

static const char *const given[] = {@GIVEN@};
static const char *const results[] = {@RESULTS@};

static @NAME@ estimator;
static char line[1 << 16];
static char *cells[MOST];

static long lines;

static int refused(const char *path, const char *what, const char *which) {
    fprintf(stderr, "%s: line %ld: %s%s\n", path, lines, what, which);
    exit(2);
}

/* Return a cell without blanks and quotes around it. */
static char *bare(char *cell) {
    size_t size;
    cell += strspn(cell, " \t\"");
    size = strlen(cell);
    while (size > 0 && strchr(" \t\"", cell[size - 1]) != NULL) {
        cell[--size] = '\0';
    }
    return cell;
}

/* Read the cells of the next line that is not blank; return how many. */
static int read_line(FILE *file, const char *path) {
    int count = 0;
    char *at = line;
    size_t size;
    do {
        if (fgets(line, sizeof line, file) == NULL) {
            return 0;
        }
        lines++;
        if (strlen(line) == sizeof line - 1) {
            refused(path, "is too long", "");
        }
        size = strlen(line);
        while (size > 0 && strchr("\r\n", line[size - 1]) != NULL) {
            line[--size] = '\0';
        }
        if (strchr(line, '\r') != NULL) {
            refused(path, "has carriage returns within; end lines by a line feed", "");
        }
    } while (line[strspn(line, " \t")] == '\0');
    if (lines == 1 && strncmp(line, "\xef\xbb\xbf", 3) == 0) {
        at += 3; /* a byte order mark */
    }
    while (at != NULL) {
        char *next = strchr(at, ',');
        if (next != NULL) {
            *next++ = '\0';
        }
        if (count == MOST) {
            refused(path, "has too many cells", "");
        }
        cells[count++] = bare(at);
        at = next;
    }
    return count;
}

static int column_of(const char *path, const char *name, int count) {
    int column = -1;
    for (int i = 0; i < count; i++) {
        if (strcmp(cells[i], name) == 0) {
            if (column >= 0) {
                refused(path, "there are two columns ", name);
            }
            column = i;
        }
    }
    return column;
}

static double number(const char *path, int column) {
    char *end;
    double value;
    if (column < 0 || cells[column][0] == '\0') {
        return (double) NAN;
    }
    value = strtod(cells[column], &end);
    if (*end != '\0' || isinf(value)) {
        refused(path, "is no number: ", cells[column]);
    }
    return value;
}

static void step(const double *values, double *computed, bool *outside) {
    @NAME@_inputs inputs;
    @NAME@_measurements measurements;
    @NAME@_outcome outcome;
@TAKE@
    *outside = outcome.outside;
}

int main(int argc, char **argv) {
    int checks = argc > 1 && strcmp(argv[1], "check") == 0;
    const char *path = argc > 1 + checks ? argv[1 + checks] : NULL;
    double tolerance = argc > 3 ? strtod(argv[3], NULL) : @TOLERANCE@;
    int columns[GIVEN + 1], expected[RESULTS], count, width, clock, failed = 0;
    double began = 0.0, before = 0.0, values[GIVEN + 1];
    double computed[RESULTS], off[RESULTS] = {0.0}, largest[RESULTS] = {0.0};
    long samples = 0;
    bool outside = false;
    @NAME@_belief belief;
    FILE *file = path == NULL ? NULL : fopen(path, "r");
    if (path != NULL && file == NULL) {
        fprintf(stderr, "%s: cannot be read\n", path);
        return 2;
    }
    if (file == NULL || (count = read_line(file, path)) == 0) {
        fprintf(stderr, "usage: %s [check] FILE.csv [TOLERANCE]; a file that is not empty\n", argv[0]);
        return 2;
    }
    for (int i = 0; i < GIVEN; i++) {
        columns[i] = column_of(path, given[i], count);
        if (columns[i] < 0 && i < INPUTS) {
            fprintf(stderr, "%s has no column '%s', which is an input; commas separate columns\n", path, given[i]);
            return 2;
        }
        if (columns[i] < 0) {
            fprintf(stderr, "%s has no column '%s': this measurement is missing throughout\n", path, given[i]);
        }
    }
    clock = column_of(path, "time", count);
    fputs(checks || clock < 0 ? "" : "time,", stdout);
    for (int i = 0; i < RESULTS; i++) {
        expected[i] = column_of(path, results[i], count);
        if (checks && expected[i] < 0 && i < @UPPER@_ESTIMATES) {
            fprintf(stderr, "%s has no column '%s' to compare with\n", path, results[i]);
            return 2;
        }
        printf("%s%s", checks ? "" : results[i], checks ? "" : ",");
    }
    fputs(checks ? "" : "outside\n", stdout);
    @NAME@_believe(&belief);
    @NAME@_begin(&estimator, &belief);
    while ((width = read_line(file, path)) > 0) {
        double now;
        if (width != count) {
            refused(path, "has more or fewer cells than the first line", "");
        }
        now = number(path, clock);
        began = samples == 0 ? now : began;
        /* Stamps may jitter, but not drift from the step by more than a thousandth. */
        if (clock >= 0 && samples > 0
            && !(fabs(now - before - @UPPER@_STEP) < 0.1 * @UPPER@_STEP
                 && fabs(now - began - (double) samples * @UPPER@_STEP) < @UPPER@_STEP + 0.001 * (now - began))) {
            refused(path, "time does not go on by the estimator's step in s, which is ", "@STEP@");
        }
        before = now;
        for (int i = 0; i < GIVEN; i++) {
            values[i] = number(path, columns[i]);
            if (i < INPUTS && isnan(values[i])) {
                refused(path, "there is no number of the input ", given[i]);
            }
        }
        step(values, computed, &outside);
        if (!checks && clock >= 0) {
            printf("%.15g,", now);
        }
        for (int i = 0; i < RESULTS; i++) {
            double other = number(path, expected[i]);
            if (!checks) {
                printf("%.9g,", computed[i]);
            } else if (isnan(computed[i]) != isnan(other) && expected[i] >= 0) {
                off[i] = (double) INFINITY;
            } else if (!isnan(other)) {
                off[i] = fmax(off[i], fabs(computed[i] - other));
                largest[i] = fmax(largest[i], fabs(other));
            }
        }
        fputs(checks ? "" : outside ? "1\n" : "0\n", stdout);
        samples++;
    }
    fclose(file);
    if (!checks && samples == 0) {
        refused(path, "there is no sample behind it", "");
    }
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
