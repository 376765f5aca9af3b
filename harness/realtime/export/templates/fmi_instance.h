/* What FMI 2.0 and 3.0 have in common: instances, their life, their variables and their messages. The file before this
 * has the variables and the model (fmi_model.h), and say, which hands a message to the importer. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { IS_OK = 0, IS_ERROR = 3 }; /* as FMI numbers them */

typedef enum { INSTANTIATED, INITIALIZING, STEPPING, TERMINATED } phase;

/* All that an instance holds of a run: the state of the FMU, copied as it is. */
typedef struct {
    char token[sizeof MODEL_TOKEN];
    phase at;
    bool changed; /* whether outputs do not follow yet from what was set */
    double start; /* s */
    double steps; /* of the model, since then */
    double values[VARIABLES];
    model model;
} memory;

typedef struct {
    memory now;
    callbacks importer;
} instance;

static int refused(const instance *c, int status, const char *what, const char *which) {
    char text[512];
    snprintf(text, sizeof text, "%s%s", what, which);
    say(&c->importer, status, text);
    return status;
}

static double time_of(const instance *c) {
    return c->now.start + c->now.steps * MODEL_STEP;
}

static void restart(instance *c) {
    memset(&c->now, 0, sizeof c->now);
    memcpy(c->now.token, MODEL_TOKEN, sizeof MODEL_TOKEN);
    for (int i = 0; i < VARIABLES; i++) {
        c->now.values[i] = variables[i].start;
    }
}

/* Return a new instance; NULL if the token is of another model. */
static instance *instantiated(callbacks importer, const char *token) {
    instance *c = NULL;
    if (token == NULL || strcmp(token, MODEL_TOKEN) != 0) {
        say(&importer, IS_ERROR, "the token of the model description is not that of this library: " MODEL_TOKEN);
        return NULL;
    }
    c = calloc(1, sizeof *c);
    if (c == NULL) {
        say(&importer, IS_ERROR, "there is no memory for an instance");
        return NULL;
    }
    c->importer = importer;
    restart(c);
    return c;
}

/* Refuse what is set and is no number, or beyond what it may be, although the model needs it. */
static int acceptable(const instance *c, bool parameters) {
    for (int i = 0; i < VARIABLES; i++) {
        if (variables[i].role != 'i' && !(parameters && variables[i].role == 'p')) {
            continue;
        }
        if (!isfinite(c->now.values[i])) {
            return refused(c, IS_ERROR, "is no number: ", variables[i].name);
        }
        if (c->now.values[i] < variables[i].least || c->now.values[i] > variables[i].most) {
            char text[128];
            snprintf(text, sizeof text, " = %.9g, which may be %.9g to %.9g", c->now.values[i], variables[i].least,
                     variables[i].most);
            return refused(c, IS_ERROR, variables[i].name, text);
        }
    }
    return IS_OK;
}

static int enter_initialization(instance *c, double start) {
    if (c->now.at != INSTANTIATED) {
        return refused(c, IS_ERROR, "it is initialised already: reset it first", "");
    }
    c->now.start = start;
    c->now.at = INITIALIZING;
    c->now.changed = true;
    return IS_OK;
}

/* Let outputs follow from what was set. */
static int follow(instance *c) {
    if (!c->now.changed || c->now.at == INSTANTIATED) {
        return IS_OK;
    }
    c->now.values[TIME] = time_of(c);
    if (c->now.at == INITIALIZING) {
        const int status = acceptable(c, true);
        if (status != IS_OK) {
            return status;
        }
        model_begin(&c->now.model, c->now.values);
    } else {
        model_follow(&c->now.model, c->now.values);
    }
    c->now.changed = false;
    return IS_OK;
}

static int exit_initialization(instance *c) {
    int status;
    if (c->now.at != INITIALIZING) {
        return refused(c, IS_ERROR, "it is not being initialised", "");
    }
    c->now.changed = true;
    status = follow(c);
    c->now.at = status == IS_OK ? STEPPING : INITIALIZING;
    return status;
}

/* Take a communication step, which is one of the model or several. */
static int advance(instance *c, double at, double size) {
    const double count = floor(size / MODEL_STEP + 0.5);
    char text[256];
    if (c->now.at != STEPPING) {
        return refused(c, IS_ERROR, "it cannot step: it is not initialised, or terminated", "");
    }
    if (!(fabs(at - time_of(c)) <= 0.5 * MODEL_STEP)) {
        snprintf(text, sizeof text, "the step is to begin at %.9g s, but the instance is at %.9g s", at, time_of(c));
        return refused(c, IS_ERROR, text, "");
    }
    if (!(count >= 1.0 && fabs(size - count * MODEL_STEP) <= 1e-6 * MODEL_STEP)) {
        snprintf(text, sizeof text, "a step of %.9g s is no multiple of %.9g s, which is that of the model", size,
                 MODEL_STEP);
        return refused(c, IS_ERROR, text, ""); /* discarded, some importers would try the same step for ever */
    }
    if (acceptable(c, false) != IS_OK) {
        return IS_ERROR;
    }
    for (double i = 1.0; i <= count; i++) {
        model_step(&c->now.model, c->now.values, i == count);
        c->now.steps++;
    }
    c->now.values[TIME] = time_of(c);
    c->now.changed = false;
    return IS_OK;
}

/* Return the place of a variable of a type; NULL if there is none. */
static double *place(instance *c, uint32_t reference, char type) {
    if (reference >= VARIABLES || variables[reference].type != type) {
        char text[64];
        snprintf(text, sizeof text, "%lu", (unsigned long) reference);
        refused(c, IS_ERROR, "there is no variable of that type with the value reference ", text);
        return NULL;
    }
    return &c->now.values[reference];
}

/* Return the place of a variable that may be set now; NULL if there is none. */
static double *room(instance *c, uint32_t reference, char type) {
    double *there = place(c, reference, type);
    if (there == NULL) {
        return NULL;
    }
    if (variables[reference].role == 'o' || variables[reference].role == 't') {
        refused(c, IS_ERROR, "is an output and cannot be set: ", variables[reference].name);
        return NULL;
    }
    if (variables[reference].role == 'p' && c->now.at > INITIALIZING) {
        refused(c, IS_ERROR, "is fixed once initialised; reset, then set it: ", variables[reference].name);
        return NULL;
    }
    c->now.changed = true;
    return there;
}

/* Get and set variables of a type. */
#define GET(c, references, count, type, convert, to)                                                                   \
    do {                                                                                                               \
        int status = follow(c);                                                                                        \
        for (size_t i = 0; i < (count) && status == IS_OK; i++) {                                                      \
            const double *from = place(c, (references)[i], type);                                                      \
            if (from == NULL) {                                                                                        \
                status = IS_ERROR;                                                                                     \
            } else {                                                                                                   \
                (to)[i] = convert(*from);                                                                              \
            }                                                                                                          \
        }                                                                                                              \
        return status;                                                                                                 \
    } while (0)

#define SET(c, references, count, type, from)                                                                          \
    do {                                                                                                               \
        for (size_t i = 0; i < (count); i++) {                                                                         \
            double *there = room(c, (references)[i], type);                                                            \
            if (there == NULL) {                                                                                       \
                return IS_ERROR;                                                                                       \
            }                                                                                                          \
            *there = (double) (from)[i];                                                                               \
        }                                                                                                              \
        return IS_OK;                                                                                                  \
    } while (0)

#define AS_REAL(x) (x)
#define AS_INTEGER(x) ((int) (x))
#define AS_TRUTH(x) ((x) != 0.0)

static int kept(const instance *c, const void *from, size_t size, void **to) {
    if (from == NULL || size != sizeof c->now || memcmp(from, MODEL_TOKEN, sizeof MODEL_TOKEN) != 0) {
        return refused(c, IS_ERROR, "is no state of this model", "");
    }
    if (*to == NULL) {
        *to = malloc(size);
    }
    if (*to == NULL) {
        return refused(c, IS_ERROR, "there is no memory for a state", "");
    }
    memcpy(*to, from, size);
    return IS_OK;
}

static int restored(instance *c, const void *from) {
    void *to = &c->now;
    return kept(c, from, sizeof c->now, &to);
}

static int written(const instance *c, const void *state, void *to, size_t size) {
    return size < sizeof c->now ? refused(c, IS_ERROR, "there is no room for the state", "")
                                : kept(c, state, sizeof c->now, &to);
}
