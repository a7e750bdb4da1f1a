/*
 * Values of the variables; follows fmi2_unit.h.
 */
FMI2_FUNCTION(fmi2Status, fmi2GetReal)(fmi2Component component, const fmi2ValueReference which[],
                                       size_t count, fmi2Real values[])
{
    fmi2_unit *unit = (fmi2_unit *)component;
    size_t k;

    if (!unit) return fmi2Error;
    fmi2_refresh(&unit->now);
    for (k = 0; k < count; k++) {
        if (which[k] >= MODEL_REALS) return fmi2_refuse(component, "there is no such real variable");
        values[k] = unit->now.reals[which[k]];
    }
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2GetBoolean)(fmi2Component component,
                                          const fmi2ValueReference which[], size_t count,
                                          fmi2Boolean values[])
{
    fmi2_unit *unit = (fmi2_unit *)component;
    size_t k;

    if (!unit) return fmi2Error;
    fmi2_refresh(&unit->now);
    for (k = 0; k < count; k++) {
        if (which[k] >= MODEL_BOOLEANS) {
            return fmi2_refuse(component, "there is no such boolean variable");
        }
        values[k] = unit->now.booleans[which[k]] ? fmi2True : fmi2False;
    }
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2SetReal)(fmi2Component component, const fmi2ValueReference which[],
                                       size_t count, const fmi2Real values[])
{
    fmi2_unit *unit = (fmi2_unit *)component;
    size_t k;

    if (!unit || unit->now.phase == TERMINATED) {
        return fmi2_refuse(component, "nothing can be set any more");
    }
    for (k = 0; k < count; k++) {
        if (which[k] >= MODEL_SETTABLE) {
            return fmi2_refuse(component, "a variable is neither an input nor a parameter");
        }
        if (which[k] >= MODEL_INPUTS && unit->now.phase == STEPPING) {
            return fmi2_refuse(component, "a parameter is fixed after initialization");
        }
        if (which[k] >= MODEL_INPUTS &&
            !(isfinite(values[k]) && values[k] >= model_least[which[k]])) {
            return fmi2_refuse(component, "the value of a parameter is not allowed");
        }
    }
    for (k = 0; k < count; k++) {
        if (!(unit->now.reals[which[k]] == values[k])) unit->now.stale = 1;
        unit->now.reals[which[k]] = values[k];
    }
    return fmi2OK;
}

static fmi2Status fmi2_none(fmi2Component component, size_t count)
{
    if (component && count == 0) return fmi2OK;
    return fmi2_refuse(component, "there is no such variable");
}

FMI2_FUNCTION(fmi2Status, fmi2GetInteger)(fmi2Component component,
                                          const fmi2ValueReference which[], size_t count,
                                          fmi2Integer values[])
{
    (void)which, (void)values;
    return fmi2_none(component, count);
}

FMI2_FUNCTION(fmi2Status, fmi2GetString)(fmi2Component component, const fmi2ValueReference which[],
                                         size_t count, fmi2String values[])
{
    (void)which, (void)values;
    return fmi2_none(component, count);
}

FMI2_FUNCTION(fmi2Status, fmi2SetInteger)(fmi2Component component,
                                          const fmi2ValueReference which[], size_t count,
                                          const fmi2Integer values[])
{
    (void)which, (void)values;
    return fmi2_none(component, count);
}

FMI2_FUNCTION(fmi2Status, fmi2SetBoolean)(fmi2Component component,
                                          const fmi2ValueReference which[], size_t count,
                                          const fmi2Boolean values[])
{
    (void)which, (void)values;
    return fmi2_none(component, count);
}

FMI2_FUNCTION(fmi2Status, fmi2SetString)(fmi2Component component, const fmi2ValueReference which[],
                                         size_t count, const fmi2String values[])
{
    (void)which, (void)values;
    return fmi2_none(component, count);
}
