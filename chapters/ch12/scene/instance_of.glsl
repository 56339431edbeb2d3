// The record of an instance. A shader sees so many bytes of one buffer (128 MiB on many devices, 699,048 records): a scene
// with more instances has a second binding for the rest.

#ifdef INSTANCES_PER_PAGE
Instance instance_of(uint number) {
    if (number < INSTANCES_PER_PAGE) {
        return instances[number];
    }
    return more_instances[number - INSTANCES_PER_PAGE];
}
#else
Instance instance_of(uint number) { return instances[number]; }
#endif
