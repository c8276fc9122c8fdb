/* The calls of HDAPI that servo loops use, with the SDK's names and types.
 *
 * The servo thread is the scheduler's. A callback reads and writes a device between hdBeginFrame and hdEndFrame, and
 * errors are not returned but put on a stack that hdGetError empties, newest first.
 */
#ifndef HD_HD_H
#define HD_HD_H

#include <HD/hdDefines.h>

#ifdef __cplusplus
extern "C" {
#endif

#define HD_DEVICE_ERROR(X) (((X).errorCode) != HD_SUCCESS)

HDAPI HDErrorInfo HDAPIENTRY hdGetError(void);
HDAPI HDstring HDAPIENTRY hdGetErrorString(HDerror errorCode);

HDAPI HHD HDAPIENTRY hdInitDevice(HDstring pConfigName);
HDAPI void HDAPIENTRY hdDisableDevice(HHD hHD);
HDAPI void HDAPIENTRY hdMakeCurrentDevice(HHD hHD);
HDAPI HHD HDAPIENTRY hdGetCurrentDevice(void);

HDAPI void HDAPIENTRY hdBeginFrame(HHD hHD);
HDAPI void HDAPIENTRY hdEndFrame(HHD hHD);

HDAPI void HDAPIENTRY hdEnable(HDenum cap);
HDAPI void HDAPIENTRY hdDisable(HDenum cap);
HDAPI HDboolean HDAPIENTRY hdIsEnabled(HDenum cap);

HDAPI void HDAPIENTRY hdGetBooleanv(HDenum pname, HDboolean *params);
HDAPI void HDAPIENTRY hdGetIntegerv(HDenum pname, HDint *params);
HDAPI void HDAPIENTRY hdGetLongv(HDenum pname, HDlong *params);
HDAPI void HDAPIENTRY hdGetFloatv(HDenum pname, HDfloat *params);
HDAPI void HDAPIENTRY hdGetDoublev(HDenum pname, HDdouble *params);
HDAPI HDstring HDAPIENTRY hdGetString(HDenum pname);
HDAPI void HDAPIENTRY hdSetBooleanv(HDenum pname, const HDboolean *params);
HDAPI void HDAPIENTRY hdSetIntegerv(HDenum pname, const HDint *params);
HDAPI void HDAPIENTRY hdSetLongv(HDenum pname, const HDlong *params);
HDAPI void HDAPIENTRY hdSetFloatv(HDenum pname, const HDfloat *params);
HDAPI void HDAPIENTRY hdSetDoublev(HDenum pname, const HDdouble *params);

HDAPI HDenum HDAPIENTRY hdCheckCalibration(void);
HDAPI void HDAPIENTRY hdUpdateCalibration(HDenum style);

typedef HDulong HDSchedulerHandle;
typedef HDuint HDCallbackCode;
#define HD_CALLBACK_DONE 0
#define HD_CALLBACK_CONTINUE 1
typedef HDCallbackCode(HDCALLBACK *HDSchedulerCallback)(void *pUserData);
typedef HDuint HDWaitCode;
#define HD_WAIT_CHECK_STATUS 0
#define HD_WAIT_INFINITE 1

HDAPI void HDAPIENTRY hdStartScheduler(void);
HDAPI void HDAPIENTRY hdStopScheduler(void);
HDAPI void HDAPIENTRY hdSetSchedulerRate(HDulong nRate);
HDAPI void HDAPIENTRY hdScheduleSynchronous(HDSchedulerCallback pCallback, void *pUserData, HDushort nPriority);
HDAPI HDSchedulerHandle HDAPIENTRY hdScheduleAsynchronous(HDSchedulerCallback pCallback, void *pUserData,
                                                          HDushort nPriority);
HDAPI void HDAPIENTRY hdUnschedule(HDSchedulerHandle hHandle);
HDAPI HDboolean HDAPIENTRY hdWaitForCompletion(HDSchedulerHandle hHandle, HDWaitCode param);
HDAPI HDdouble HDAPIENTRY hdGetSchedulerTimeStamp(void);

#ifdef __cplusplus
}
#endif

#endif
