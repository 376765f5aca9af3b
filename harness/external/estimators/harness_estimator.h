/* An estimator in C for the robustness harness: kind = "external", library = "libobserver.so" in a study.
 *
 *     cc -O2 -shared -fPIC observer.c -o libobserver.so
 *
 * All numbers are in SI units, or in those that the study states, in the order that it states. NaN is a measurement that
 * is missing; all are at the first sample, where dt is 0. Any status but 0 ends the run, which counts as diverged.
 */
#ifndef HARNESS_ESTIMATOR_H
#define HARNESS_ESTIMATOR_H
#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    int inputs, measurements, estimates; /* how many of each a step gets and gives */
    int values;                          /* numbers of the belief that reset gets: "values" in the study */
    int state_bytes;                     /* memory of a run, all zero before reset, aligned for doubles */
} harness_sizes_t;

/* Say how many there are; the study is refused if it states others. */
void harness_sizes(harness_sizes_t *sizes);

/* Begin a run. step: sample time in s. */
int harness_reset(void *state, const double *values, double step);

/* Take one sample. inputs are those known now and held until the next. dt: s since the last one. variances (of the
 * estimates) and nis are NaN before; what is written there counts if the study states variances = true, nis = true. */
int harness_step(void *state, const double *inputs, const double *measurements, double dt, double *estimates,
                 double *variances, double *nis);

#ifdef __cplusplus
}
#endif
#endif
