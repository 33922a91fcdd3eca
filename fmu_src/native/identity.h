/* Which FMU the binary belongs to; written by build_fmu.py when everything else of it is known. */
#ifndef IDENTITY_H
#define IDENTITY_H

extern const char model_guid[];

#endif
