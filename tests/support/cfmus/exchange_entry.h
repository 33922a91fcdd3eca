/* What the FMUs of model exchange export alike in FMI 2.0 and 3.0. */
Status FMI(EnterEventMode)(Instance c) { return OK; }
Status FMI(EnterContinuousTimeMode)(Instance c) { return OK; }
Status FMI(CompletedIntegratorStep)(Instance c, Flag no_set, Flag *event, Flag *end) {
    *event = *end = 0;
    return OK;
}
Status FMI(SetTime)(Instance c, Number time) {
    ((Model *)c)->time = time;
    return OK;
}
Status FMI(SetContinuousStates)(Instance c, const Number x[], size_t n) {
    ((Model *)c)->reals[X] = x[0], ((Model *)c)->reals[V] = x[1];
    return OK;
}
Status FMI(GetContinuousStates)(Instance c, Number x[], size_t n) {
    x[0] = ((Model *)c)->reals[X], x[1] = ((Model *)c)->reals[V];
    return OK;
}
Status DERIVATIVES(Instance c, Number dx[], size_t n) {
    dx[0] = model_get(c, V), dx[1] = model_get(c, DV);
    return OK;
}
Status FMI(GetEventIndicators)(Instance c, Number z[], size_t n) {
    z[0] = indicator(c);
    return OK;
}
Status FMI(GetNominalsOfContinuousStates)(Instance c, Number x[], size_t n) {
    x[0] = x[1] = 1;
    return OK;
}
