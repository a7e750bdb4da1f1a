/*
 * States to return to, and steps; follows fmi2_variables.h.
 */
FMI2_FUNCTION(fmi2Status, fmi2GetFMUstate)(fmi2Component component, fmi2FMUstate *state)
{
    fmi2_unit *unit = (fmi2_unit *)component;

    if (!unit || !state) return fmi2Error;
    if (!*state) *state = fmi2_allocate(&unit->host, sizeof(fmi2_snapshot));
    if (!*state) return fmi2_refuse(component, "there is no memory for a state");
    memcpy(*state, &unit->now, sizeof unit->now);
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2SetFMUstate)(fmi2Component component, fmi2FMUstate state)
{
    fmi2_unit *unit = (fmi2_unit *)component;

    if (!unit || !state) return fmi2Error;
    memcpy(&unit->now, state, sizeof unit->now);
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2FreeFMUstate)(fmi2Component component, fmi2FMUstate *state)
{
    fmi2_unit *unit = (fmi2_unit *)component;

    if (!unit) return fmi2Error;
    if (state && *state) {
        fmi2_release(&unit->host, *state);
        *state = NULL;
    }
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2SerializedFMUstateSize)(fmi2Component component, fmi2FMUstate state,
                                                      size_t *size)
{
    if (!component || !state || !size) return fmi2Error;
    *size = sizeof(fmi2_snapshot);
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2SerializeFMUstate)(fmi2Component component, fmi2FMUstate state,
                                                 fmi2Byte bytes[], size_t size)
{
    if (!component || !state || !bytes) return fmi2Error;
    if (size < sizeof(fmi2_snapshot)) return fmi2_refuse(component, "too few bytes for a state");
    memcpy(bytes, state, sizeof(fmi2_snapshot));
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2DeSerializeFMUstate)(fmi2Component component, const fmi2Byte bytes[],
                                                   size_t size, fmi2FMUstate *state)
{
    fmi2_unit *unit = (fmi2_unit *)component;

    if (!unit || !bytes || !state) return fmi2Error;
    if (size != sizeof(fmi2_snapshot)) {
        return fmi2_refuse(component, "these bytes are no state of this unit");
    }
    if (!*state) *state = fmi2_allocate(&unit->host, sizeof(fmi2_snapshot));
    if (!*state) return fmi2_refuse(component, "there is no memory for a state");
    memcpy(*state, bytes, sizeof(fmi2_snapshot));
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2DoStep)(fmi2Component component, fmi2Real time, fmi2Real span,
                                      fmi2Boolean no_return)
{
    fmi2_unit *unit = (fmi2_unit *)component;
    const char *problem;

    (void)no_return;
    if (!unit || unit->now.phase != STEPPING) {
        return fmi2_refuse(component, "steps are taken after initialization only");
    }
    if (!isfinite(time) || !isfinite(span) || span < 0.0) {
        return fmi2_refuse(component, "a step needs a time and a length that is not negative");
    }
    problem = model_advance(&unit->now.memory, unit->now.reals, unit->now.booleans, time, span);
    if (problem) return fmi2_refuse(component, problem);
    unit->now.time = time + span;
    unit->now.stale = 0;
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2CancelStep)(fmi2Component component)
{
    return fmi2_refuse(component, "no step is pending");
}

FMI2_FUNCTION(fmi2Status, fmi2SetRealInputDerivatives)(fmi2Component component,
                                                       const fmi2ValueReference which[],
                                                       size_t count, const fmi2Integer order[],
                                                       const fmi2Real values[])
{
    (void)which, (void)order, (void)values;
    return fmi2_none(component, count);
}

FMI2_FUNCTION(fmi2Status, fmi2GetRealOutputDerivatives)(fmi2Component component,
                                                        const fmi2ValueReference which[],
                                                        size_t count, const fmi2Integer order[],
                                                        fmi2Real values[])
{
    (void)which, (void)order, (void)values;
    return fmi2_none(component, count);
}

FMI2_FUNCTION(fmi2Status, fmi2GetDirectionalDerivative)(fmi2Component component,
                                                        const fmi2ValueReference unknown[],
                                                        size_t unknowns,
                                                        const fmi2ValueReference known[],
                                                        size_t knowns, const fmi2Real change[],
                                                        fmi2Real values[])
{
    (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)change, (void)values;
    return fmi2_refuse(component, "this unit gives no derivatives");
}

FMI2_FUNCTION(fmi2Status, fmi2GetStatus)(fmi2Component component, const fmi2StatusKind kind,
                                         fmi2Status *value)
{
    (void)component, (void)kind, (void)value;
    return fmi2Discard; /* every step is finished when fmi2DoStep returns */
}

FMI2_FUNCTION(fmi2Status, fmi2GetRealStatus)(fmi2Component component, const fmi2StatusKind kind,
                                             fmi2Real *value)
{
    if (!component || !value || kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = ((fmi2_unit *)component)->now.time;
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2GetIntegerStatus)(fmi2Component component, const fmi2StatusKind kind,
                                                fmi2Integer *value)
{
    (void)component, (void)kind, (void)value;
    return fmi2Discard;
}

FMI2_FUNCTION(fmi2Status, fmi2GetBooleanStatus)(fmi2Component component, const fmi2StatusKind kind,
                                                fmi2Boolean *value)
{
    (void)component, (void)kind, (void)value;
    return fmi2Discard;
}

FMI2_FUNCTION(fmi2Status, fmi2GetStringStatus)(fmi2Component component, const fmi2StatusKind kind,
                                               fmi2String *value)
{
    (void)component, (void)kind, (void)value;
    return fmi2Discard;
}
