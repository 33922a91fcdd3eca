/* A model that is what its start_values make of it: new, reset and freed. */
static Model *model_new(void) {
    Model *m = malloc(sizeof *m);
    start_values(m);
    return m;
}

static void model_free(Model *m) { free(m); }

static int model_reset(Model *m) {
    start_values(m);
    return 0;
}
