/* What every test FMU exports alike in FMI 2.0 and 3.0, over a model that has a type `Model` with
   `reals` and the functions model_new, model_free, model_begin, model_initialise, model_reset and
   model_get. FMI, Instance, Status, OK and ERROR are those of the version: see entry2.h, entry3.h. */
void FMI(FreeInstance)(Instance c) { model_free(c); }
Status FMI(ExitInitializationMode)(Instance c) {
    model_initialise(c);
    return OK;
}
Status FMI(Terminate)(Instance c) { return OK; }
Status FMI(Reset)(Instance c) { return model_reset(c) ? ERROR : OK; }
